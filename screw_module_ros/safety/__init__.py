# SPDX-License-Identifier: Apache-2.0
"""Whether torque may pass: what is judged (`checks`), what follows (`permit`, `supervision`).

`latch` has the two ideas that all of them share: the first reason stays until it is cleared, and a
signal is valid only while it is fresh. Pure: no clock, no bus, no ROS.
"""
