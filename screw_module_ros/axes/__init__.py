# SPDX-License-Identifier: Apache-2.0
"""Laws joined to drives, without ROS: what the nodes `amplifier` and `manus` run."""
