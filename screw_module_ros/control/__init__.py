# SPDX-License-Identifier: Apache-2.0
"""Pure laws of the robot: functions of (settings, state, input, dt), without I/O and without ROS.

`vertical` is the complete vertical law, `planar` the planar one. `torque_chain` turns a force into
the drive's torque. `watch`, `agreement`, `freeze`, `gate`, `supervision` and `timing` decide
whether a torque may pass.
"""
