# SPDX-License-Identifier: Apache-2.0
"""The vertical loop and the plane loop: what a robot does in each period, without ROS."""
