# SPDX-License-Identifier: Apache-2.0
"""Laws of the robot: functions of (settings, state, input, dt), without I/O and without ROS.

A function of a law changes the record of its own memory, which it is given, and nothing else.

`vertical` is the complete vertical law, `planar` the planar one. `torque_chain` turns a force into
the drive's torque. Whether a torque may pass is decided in `safety`.
"""
