# SPDX-License-Identifier: Apache-2.0
"""ATI Net F/T box on plain CAN (ATI manual 9620-05-Net FT, chapter 15).

A request of one byte, 0x02, to the base identifier; two replies, little-endian: base + 5 with Fx,
Tx, Fy, Ty, base + 6 with Fz, Tz, status and sample number. The box applies its own calibration; its
counts per N and Nm stand on its web page only. It has no reset and no slow values on CAN.
"""

from __future__ import annotations

import struct
from typing import Any

from ..can_io.port import Port
from .ati import SATURATED
from .errors import NotAnswering, NotConfigured
from .force_base import AXES, Row
from .force_frames import FrameSensor
from .force_sensor_settings import ForceSensorSettings

SHORT_DATA = b"\x02"
FIRST, SECOND = 5, 6
#: Fx, Tx, Fy, Ty; then Fz, Tz, status, sample number.
FORCES_XY = struct.Struct("<hhhh")
FORCES_Z = struct.Struct("<hhHH")
#: Bit 15 of the short status word (bit 31 of the long one): an error that spoils the sample.
ERROR = 1 << 15
_TRIES = 2


class NetForceSensor(FrameSensor):
    """Driver of a Net F/T box. counters: also repeated (sample numbers that did not move on, whose
    samples are withheld), box_errors (samples that its status word spoils, which are withheld).
    """

    REQUEST = SHORT_DATA
    SIZES = FORCES_XY.size, FORCES_Z.size
    SATURATED = SATURATED
    FORGETS = False
    identity = "ATI Net F/T on CAN"  # it does not tell its serial number there

    def __init__(
        self,
        port: Port,
        settings: ForceSensorSettings,
        label: str = "force sensor",
        own: Any = None,
    ):
        poll = settings.base_id << 4
        super().__init__(port, settings, label, own, poll, (poll + FIRST, poll + SECOND))
        self._number: int | None = None

    def identify(self) -> list[Row]:
        """Return its units, once it answers. Raises NotConfigured without its counts per unit."""
        settings = self.settings
        if not (settings.counts_per_force and settings.counts_per_torque):
            raise NotConfigured(
                f"{self.label}: counts_per_force and counts_per_torque of the Net F/T box are "
                "needed, after its 16-bit scaling: its web page shows them"
            )
        self._await_answer()
        self._number = None
        units = [1.0 / settings.counts_per_force] * 3 + [1.0 / settings.counts_per_torque] * 3
        return [tuple(unit * (i == k) for k in range(AXES)) for i, unit in enumerate(units)]

    def _await_answer(self) -> None:
        """Raise NotAnswering unless the box answers one of two requests."""
        found: list[bytes] = []

        def take(data: bytes, _arrival_ns: int) -> None:
            found.append(data)

        reply = self.answer_ids[-1]
        self.port.subscribe(reply, take)
        try:
            for _ in range(_TRIES):
                self.port.send(self.request_id, SHORT_DATA)
                if self.port.wait_for(lambda: bool(found), self.settings.timeout):
                    return
        finally:
            self.port.unsubscribe(reply, take)
        raise NotAnswering(
            f"{self.label} (Net F/T, {self.place}) does not answer on "
            f"{self.port.name}; check its power, cable, DIP switches, bit rate, and that CAN is "
            "chosen on its web page"
        )

    def values(self, *frames: bytes) -> tuple[int, tuple[float, ...] | None]:
        """Return no status and the counts of Fx, Fy, Fz, Tx, Ty, Tz."""
        first, second = frames
        fx, tx, fy, ty = FORCES_XY.unpack(first)
        fz, tz, status, number = FORCES_Z.unpack(second)
        before, self._number = self._number, number
        if status & ERROR:
            self.counters["box_errors"] += 1
            self.latch(f"{self.label}: the Net F/T box reports an error, status 0x{status:04X}")
            return 0, None
        if number == before:
            self.counters["repeated"] += 1
            return 0, None
        return 0, (fx, fy, fz, tx, ty, tz)
