# SPDX-License-Identifier: Apache-2.0
"""The vertical loop and the plane loop: the work of one period, without ROS."""
