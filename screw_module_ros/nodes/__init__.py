# SPDX-License-Identifier: Apache-2.0
"""Thin ROS 2 nodes, one per file: topics, services and parameters for the layers below."""
