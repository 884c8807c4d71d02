# SPDX-License-Identifier: Apache-2.0
"""The robot in browsers: a subset of rosbridge v2, the rights of each role, and the pages.

It is independent of ROS: `nodes/web_bridge.py` passes it the robot as a `Gateway`.
"""
