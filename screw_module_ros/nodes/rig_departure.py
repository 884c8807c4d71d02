# SPDX-License-Identifier: Apache-2.0
"""When the simulated rig may end: after those who still need its devices to end in good order.

Ctrl-C reaches all processes of `ros2 launch` at once. A rig that left first would be a robot whose
power fails: drives that cannot be disabled, time that stands still, and warnings about both.
"""

from __future__ import annotations

import os

from screw_module_ros.clock import Clock, WallClock
from screw_module_ros.lockstep.page import alive

_PATIENCE_NS = 4_000_000_000  # ros2 launch sends SIGTERM after 5 s
_SILENT_NS = 300_000_000  # no frame for so long: nobody is left
_WALL = WallClock()


class Departure:
    """Decides whether the rig may end; the wait begins with the first question."""

    def __init__(self, clock: Clock):
        """Take the clock of the rig's process."""
        self._clock = clock
        self._until_ns: int | None = None
        self._frames = -1
        self._changed_ns = 0

    def is_due(self, frames: int) -> bool:
        """Return whether no node needs the devices any more; frames: received so far."""
        now_ns = _WALL.now_ns()
        if self._until_ns is None:
            self._until_ns = now_ns + _PATIENCE_NS
        if now_ns >= self._until_ns:
            return True
        if self._clock.simulated:
            frames = -1 if not self._others() else now_ns  # time may stand between two frames
        if frames != self._frames:
            self._frames, self._changed_ns = frames, now_ns
        return now_ns - self._changed_ns >= _SILENT_NS

    def _others(self) -> bool:
        """Return whether another living process has a bus open in this time."""
        page = self._clock.page
        return any(pid and pid != os.getpid() and alive(pid) for pid in page.line_pid)
