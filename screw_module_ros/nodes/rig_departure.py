# SPDX-License-Identifier: Apache-2.0
"""When the simulated rig may end: after the nodes that need its devices for a clean exit.

Ctrl-C reaches all processes of `ros2 launch` at once. A rig that ends first acts like a power
failure: nodes cannot disable their drives, simulated time stops, and both cause warnings.
"""

from __future__ import annotations

import os

from screw_module_ros.clock import Clock, WallClock
from screw_module_ros.lockstep.page import alive

_PATIENCE_NS = 4_000_000_000  # ros2 launch sends SIGTERM after 5 s
_SILENT_NS = 300_000_000  # after this time without a frame no node is left
_WALL = WallClock()


class Departure:
    """Decides whether the rig may end; the wait begins with the first call of `is_due`."""

    def __init__(self, clock: Clock):
        """Start with the clock of the rig's process."""
        self._clock = clock
        self._until_ns: int | None = None
        self._frames = -1
        self._changed_ns = 0

    def is_due(self, frames: int) -> bool:
        """Return whether no node needs the devices any more; frames: number received so far."""
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
        return any(pid != os.getpid() and alive(pid) for pid, _ in self._clock.page.buses())
