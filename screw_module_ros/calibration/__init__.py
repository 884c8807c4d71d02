# SPDX-License-Identifier: Apache-2.0
"""Calibration files: content of a module's file, checks of every value, load and save.

module        one module's calibration, the file that the nodes load; its two parts as own files
gain_limits   largest force gains of a linear model of it, and with what they were found
selection     the calibration that a node's parameters name

Each file is a record whose fields are the file's keys; `settings.py` reads it. The laws that use
the values are in `control/`, which reads no files.
"""
