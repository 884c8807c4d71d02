# SPDX-License-Identifier: Apache-2.0
"""`check_hardware`: what stands between a crate of devices and the first soft spring; without ROS.

`machine` looks at the computer and its CAN interfaces, `devices` asks the devices, `command` reads
the parameter file and prints the table. Nothing here enables a drive.
"""
