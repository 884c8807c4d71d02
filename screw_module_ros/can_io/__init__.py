# SPDX-License-Identifier: Apache-2.0
"""CAN buses: sockets and frames, no protocol and no device.

bus         opens one bus through python-can
port        one bus with one reader: frames in by identifier, frames out; the errors
rig_bus     a simulated bus: a UNIX socket of the rig
rig_hub     the rig's end of it
load        share of the bus capacity that the configured frames use
"""
