# SPDX-License-Identifier: Apache-2.0
"""What recorded data says about the module: evaluation, fits, figures. No ROS, no hardware."""
