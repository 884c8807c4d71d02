# SPDX-License-Identifier: Apache-2.0
"""The far end of the bus: simulated CiA 406, CiA 402 and ATI devices driven by the plant.

Written from the public standards alone and sharing no codec with `devices/`: a driver and a rig
with one codec between them would agree on a wrong layout. Reading order: `rig` (one loop), `port`
(one bus), `canopen_device` (CiA 301), `encoder`, `drive` with `cia402`, `force_sensor`, `faults`.
"""
