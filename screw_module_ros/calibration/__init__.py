# SPDX-License-Identifier: Apache-2.0
"""Calibration files: what a module's hold, the checks on every value, load and save.

`section` reads a mapping strictly, `file` a YAML file; `friction` and `linearization` are the two
parts that may also be files of their own, `content` is all of it, `module` the file the nodes load.
The laws that use the values are in `control/`, which knows no files.
"""
