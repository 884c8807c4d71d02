# SPDX-License-Identifier: Apache-2.0
"""Pure laws of the robot: functions of (settings, state, input, dt), without I/O and without ROS.

The listing is the table of contents. The vertical law is put together in `vertical`, the planar one
in `planar`; `torque_chain` makes the drive's torque of a force; `watch`, `agreement`, `freeze`,
`gate`, `supervision` and `timing` decide whether a torque may pass at all.
"""
