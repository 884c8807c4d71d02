# SPDX-License-Identifier: Apache-2.0
"""Thin ROS 2 nodes, one per file: they wire topics, services and parameters to the layers below."""
