# SPDX-License-Identifier: Apache-2.0
"""CAN buses: sockets and frames, no protocol and no device.

bus         opens one bus through python-can
port        one bus with one reader: frames in by identifier, frames out; the errors
load        share of the bus capacity that the configured frames use
"""
