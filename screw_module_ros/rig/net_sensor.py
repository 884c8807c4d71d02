# SPDX-License-Identifier: Apache-2.0
"""Simulated ATI Net F/T box on plain CAN (manual 9620-05-Net FT, chapter 15).

It answers a request of one byte, 0x02, at its base identifier with two frames, little-endian. Its
samples are numbered; it measures at 7 kHz, so two requests of a 1 kHz master are 7 numbers apart.
"""

from __future__ import annotations

import struct

from screw_module_ros.rig.force_sensor import FAULT_BITS, SimulatedForceSensor
from screw_module_ros.rig.port import Handler

_REQUEST_SHORT = 0x02
_FIRST, _SECOND = 5, 6
_XY, _Z = struct.Struct("<hhhh"), struct.Struct("<hhHH")
_ERROR = 1 << 15
_RATE = 7000.0
COUNTS_PER_NEWTON, COUNTS_PER_NEWTON_METRE = 200.0, 5000.0
"""CHOSEN: 16 bits for 160 N and 6.5 Nm."""


class SimulatedNetSensor(SimulatedForceSensor):
    """The box with its sensor; faults as of the NETCANOEM, whose gauges are its axes here."""

    _number = 0
    _zeros = (0.0,) * 6

    def _counts(self, wrench: tuple[float, ...]) -> list[float]:
        """Return Fx, Fy, Fz, Tx, Ty, Tz [counts], as the box sends them."""
        forces = [COUNTS_PER_NEWTON * force for force in wrench[:3]]
        return forces + [COUNTS_PER_NEWTON_METRE * torque for torque in wrench[3:]]

    def _handlers(self) -> dict[int, Handler]:
        return {self._base: self._request}

    def _request(self, data: bytes, now_ns: int) -> None:
        if bytes(data) != bytes((_REQUEST_SHORT,)) or now_ns < self._silent_until_ns:
            return
        self._physics.look(now_ns)
        fx, fy, fz, tx, ty, tz = self.gauges(now_ns)
        if self.stuck is None:  # a converter that hangs repeats its last sample
            self._number = round(now_ns * 1e-9 * _RATE) & 0xFFFF
        status = _ERROR if (self.status | self.injected_status) & FAULT_BITS else 0
        self._send(_FIRST, _XY.pack(fx, tx, fy, ty))
        if not self.only_first_frame:
            self._send(_SECOND, _Z.pack(fz, tz, status, self._number))
