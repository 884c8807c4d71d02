# SPDX-License-Identifier: Apache-2.0
"""Our own heartbeat (CiA 301, 7.2.8.3), sent by the loop that writes the torque.

It has no thread of its own: when the loop hangs, the heartbeat must stop, so that the drive detects
it.
"""

from __future__ import annotations

from ..can_io.port import Port
from .node import OPERATIONAL

_BASE = 0x700
_FRAME = bytes([OPERATIONAL])


class Heartbeat:
    """Heartbeat producer of this process on one bus; drives that share a bus share it.

    master_id: node id in the identifier. period: time between frames [s].
    """

    def __init__(self, port: Port, master_id: int, period: float):
        self.can_id = _BASE + master_id
        self.sent = 0
        self._port = port
        self._period_ns = round(period * 1e9)
        self._due_ns: int | None = None

    def beat(self, now_ns: int) -> None:
        """Send one frame when it is due. now_ns: CLOCK_MONOTONIC [ns]. Raises BusError."""
        if self._due_ns is not None and now_ns < self._due_ns:
            return
        self._due_ns = now_ns + self._period_ns
        self._port.send(self.can_id, _FRAME)
        self.sent += 1

    def rest(self) -> None:
        """Restart: the next `beat` sends at once."""
        self._due_ns = None
