# SPDX-License-Identifier: Apache-2.0
"""Browsers at the robot: a subset of rosbridge v2, who may ask for what, and the pages.

Knows no ROS: `nodes/web_bridge.py` gives it the robot as a `Gateway`.
"""
