# SPDX-License-Identifier: Apache-2.0
"""A ROS 2 node graph that runs a three-axis upper-limb therapy robot."""
