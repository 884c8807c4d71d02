# SPDX-License-Identifier: Apache-2.0
"""The smallest ATI NETCANOEM board, from its manual (9610-05-1030), on a bus of python-can alone.

There is no public stack for it: its protocol is no CANopen. Gauges count one to one in the matrix.
"""

from __future__ import annotations

import struct

import can

_READ_SG, _READ_MATRIX, _SERIAL, _SET_CALIBRATION, _COUNTS, _UNITS, _DIAGNOSTICS, _RESET = (
    0x0, 0x2, 0x5, 0x6, 0x7, 0x8, 0x9, 0xC,
)  # fmt: skip
_FIRMWARE = 0xF
_NEWTON, _NEWTON_METRE = 2, 3
COUNTS_PER_FORCE, COUNTS_PER_TORQUE = 100, 1000
_LOOKS_EVERY_S = 0.05


class AtiBoard:
    """The board; `gauges` are its six counts, which alternate by a count as noise does."""

    def __init__(self, channel: str, base: int = 0x12):
        self.gauges = [0] * 6
        self._noise = 0
        self._base = base
        self._bus = can.Bus(interface="virtual", channel=channel, ignore_config=True)
        self._notifier = can.Notifier(self._bus, [self._on_frame], timeout=_LOOKS_EVERY_S)

    def close(self) -> None:
        self._notifier.stop()
        self._bus.shutdown()

    def _send(self, opcode: int, data: bytes) -> None:
        can_id = self._base << 4 | opcode
        self._bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))

    def _on_frame(self, message: can.Message) -> None:
        if message.arbitration_id >> 4 != self._base:
            return
        opcode, data = message.arbitration_id & 0xF, bytes(message.data)
        fixed = {
            _SERIAL: b"FT054321",
            _COUNTS: struct.pack(">LL", COUNTS_PER_FORCE, COUNTS_PER_TORQUE),
            _UNITS: bytes([_NEWTON, _NEWTON_METRE]),
            _RESET: b"",
            _FIRMWARE: bytes([1, 0, 0, 1]),
        }
        if opcode == _READ_SG:
            self._noise ^= 1
            g0, g1, g2, g3, g4, g5 = self.gauges
            self._send(0, struct.pack(">Hhhh", 0, g0 + self._noise, g2, g4))
            self._send(1, struct.pack(">hhh", g1, g3, g5))
        elif opcode == _READ_MATRIX:
            row = [1.0 if column == data[0] else 0.0 for column in range(6)]
            for part in range(3):
                self._send(2 + part, struct.pack(">ff", *row[2 * part:2 * part + 2]))
        elif opcode == _SET_CALIBRATION:
            self._send(opcode, data)
        elif opcode == _DIAGNOSTICS:
            self._send(opcode, bytes([data[0], 0x10]))
        elif opcode in fixed:
            self._send(opcode, fixed[opcode])
