# SPDX-License-Identifier: Apache-2.0
"""ATI Net F/T box on plain CAN (ATI manual 9620-05-Net FT, chapter 15).

A request of one byte, 0x02, to the base identifier; two replies, little-endian: base + 5 with Fx,
Tx, Fy, Ty, base + 6 with Fz, Tz, status and sample number. The box applies its own calibration; its
counts per N and Nm stand on its web page only.
"""

from __future__ import annotations

import struct

from .ati import AXES, Row, SensorIdentity
from .errors import NotAnswering, NotConfigured
from .force_sensor import ForceSensor

SHORT_DATA = b"\x02"
FIRST, SECOND = 5, 6
#: Fx, Tx, Fy, Ty; then Fz, Tz, status, sample number.
FORCES_XY = struct.Struct("<hhhh")
FORCES_Z = struct.Struct("<hhHH")
#: Bit 15 of the short status word (bit 31 of the long one): an error that spoils the sample.
ERROR = 1 << 15
_IDENTITY: list[Row] = [tuple(float(i == k) for k in range(AXES)) for i in range(AXES)]
_TRIES = 2


class NetForceSensor(ForceSensor):
    """Driver of a Net F/T box. counters: those of `ForceSensor`, repeated (sample numbers that did
    not move on, whose samples are withheld), box_errors (samples that its status word spoils, which
    are withheld).
    """

    REQUEST = SHORT_DATA
    FIRST, SECOND = FIRST, SECOND
    SIZES = FORCES_XY.size, FORCES_Z.size
    SETTINGS = ()

    _number: int | None = None

    def find(self) -> tuple[SensorIdentity, list[Row]]:
        """Return its units, once it answers. Raises NotConfigured without its counts per unit."""
        settings = self.settings
        if not (settings.counts_per_force and settings.counts_per_torque):
            raise NotConfigured(
                f"{self._label}: counts_per_force and counts_per_torque of the Net F/T box are "
                "needed, after its 16-bit scaling: its web page shows them"
            )
        self._await_answer()
        self._number = None
        units = SensorIdentity("", "", settings.counts_per_force, settings.counts_per_torque)
        return units, _IDENTITY

    def _await_answer(self) -> None:
        """Raise NotAnswering unless the box answers one of two requests."""
        found: list[bytes] = []

        def take(data: bytes, _arrival_ns: int) -> None:
            found.append(data)

        reply = self._request_id | SECOND
        self._port.subscribe(reply, take)
        try:
            for _ in range(_TRIES):
                self._port.send(self._request_id, SHORT_DATA)
                if self._port.wait_for(lambda: bool(found), self.settings.timeout):
                    return
        finally:
            self._port.unsubscribe(reply, take)
        raise NotAnswering(
            f"{self._label} (Net F/T, base id 0x{self.settings.base_id:02X}) does not answer on "
            f"{self._port.name}; check its power, cable, DIP switches, bit rate, and that CAN is "
            "chosen on its web page"
        )

    @property
    def identity(self) -> str:
        """Text for hardware_id: the box does not tell its serial number on CAN."""
        return "ATI Net F/T on CAN"

    def values(self, first: bytes, second: bytes) -> tuple[int, tuple[int, ...] | None]:
        """Return no status and the counts of Fx, Fy, Fz, Tx, Ty, Tz."""
        fx, tx, fy, ty = FORCES_XY.unpack(first)
        fz, tz, status, number = FORCES_Z.unpack(second)
        before, self._number = self._number, number
        if status & ERROR:
            self.counters["box_errors"] += 1
            self._latch(f"{self._label}: the Net F/T box reports an error, status 0x{status:04X}")
            return 0, None
        if number == before:
            self.counters["repeated"] += 1
            return 0, None
        return 0, (fx, fy, fz, tx, ty, tz)

    def reset(self) -> None:
        """Find the box again: it has no reset on CAN."""
        self._running, self._needs_reset = False, False
        self._calibration_lost = True
        self.configure()

    def poll_slow(self) -> None:
        """Do nothing: the box has no slow values on CAN."""
