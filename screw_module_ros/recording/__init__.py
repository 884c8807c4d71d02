# SPDX-License-Identifier: Apache-2.0
"""Recording of sessions as rosbag2 bags (MCAP), without ROS: write, read, verify, recover."""
