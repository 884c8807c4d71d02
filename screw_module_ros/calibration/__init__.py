# SPDX-License-Identifier: Apache-2.0
"""Calibration files: content of a module's file, checks of every value, load and save.

module_file          one module's calibration, the file that the nodes load
module_fields        its keys, ranges and checksum
friction_file, linearization_file    the two parts that may also be separate files
selection            the calibration that a node's parameters name
yaml_file            YAML of a known format and version, and its identity
strict_mapping       every key known, taken once and checked

The laws that use the values are in `control/`, which reads no files.
"""
