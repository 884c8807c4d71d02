# SPDX-License-Identifier: Apache-2.0
"""Trials of the whole graph: demo, therapy, and the robot in one thread. A robot needs none."""
