# SPDX-License-Identifier: Apache-2.0
"""The far end of the bus: simulated CiA 406, CiA 402 and ATI devices, driven by the plant.

It follows the public standards and shares no codec with `devices/`: with a common codec driver and
rig would agree on a wrong layout. The physics is in `plant/`. Reading order: `rig` (one loop),
`port` (one bus), `local_bus` (a simulated bus within the rig's process), `rig_bus` and `rig_hub`
(from other processes: a UNIX socket, and the rig's end of it), `canopen_device` (CiA 301),
`encoder`, `drive` with `cia402`, `force_sensor`, `faults`.
"""
