# SPDX-License-Identifier: Apache-2.0
"""Identification of the module from samples: evaluation, fits, figures. No ROS, no hardware."""
