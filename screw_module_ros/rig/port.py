# SPDX-License-Identifier: Apache-2.0
"""One bus of the rig: it reads frames and passes each to the devices that listen to its id."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection

import can

from screw_module_ros.can_io.frames import OWN, Frame, frames_of
from screw_module_ros.clock import Clock

from .local_bus import LocalHub

Handler = Callable[[bytes, int], None]
"""Handler of a frame: called with the payload and the present time [ns]."""

COUNTED = ("frames_in", "frames_out", "ignored", "lost", "receive_errors", "send_errors")
"""Counters of a port."""


class RigPort:
    """One bus: frames in by id, frames out, counters.

    bus: any python-can bus; the caller closes it. clock: that of the other ends of the bus.
    members: for each cable on the bus a function that returns its handlers by frame id. first:
    frame id -> handler called before every device's own.
    """

    def __init__(self, bus: can.BusABC, clock: Clock):
        self.bus = bus
        self._frames = frames_of(bus)
        self._arrivals = clock.arrivals(self._frames)
        #: Frames that wait in this process, and who else is on the bus.
        self.queue: deque[Frame] = deque()
        self.far: Collection[object] = (bus,)
        if isinstance(bus, LocalHub):
            self.queue, self.far = bus.queue, bus.far
        self.members: list[Callable[[], dict[int, Handler]]] = []
        self.first: dict[int, Handler] = {}
        self.now_ns = 0
        self.frames_in = self.frames_out = self.ignored = 0
        self.receive_errors = self.send_errors = 0
        self._table: dict[int, tuple[Handler, ...]] = {}

    def fileno(self) -> int | None:
        """Return the file descriptor to select on, None if the interface has none."""
        try:
            number = self.bus.fileno()
        except NotImplementedError:
            return None
        return number if number >= 0 else None

    def rebuild(self) -> None:
        """Recompute which handlers a frame id goes to."""
        tables = [self.first, *(handlers() for handlers in self.members)]
        self._table = {
            can_id: tuple(table[can_id] for table in tables if can_id in table)
            for can_id in set().union(*tables)
        }

    @property
    def lost(self) -> int:
        """Frames that members of the bus have lost because they did not read."""
        return getattr(self.bus, "lost", 0)

    def plug(self, plugged: bool) -> None:
        """Unplug the adapter with which the nodes reach this bus, or plug it in again.

        Only a bus of the rig can show it.
        """
        if hasattr(self.bus, "plug"):
            self.bus.plug(plugged)

    def expects(self) -> bool:
        """Return whether a frame may be waiting; lock step does not foresee frames of foreign
        processes.
        """
        return bool(self.queue) or self._arrivals.expects()

    def receive(self, now_ns: int) -> bool:
        """Handle the next waiting frame without blocking; return whether there was one."""
        self.now_ns = now_ns
        try:
            frame = self.queue.popleft() if self.queue else self._arrivals.receive(0)
        except (can.CanError, OSError, ValueError):
            self.receive_errors += 1
            return False
        if frame is None:
            return False
        word, data = frame
        self.frames_in += 1
        handlers = self._table.get(word & ~OWN)  # other frames than plain ones have larger words
        if handlers is None:
            self.ignored += 1
            return True
        for handler in handlers:
            handler(data, now_ns)
        return True

    def send(self, can_id: int, data: bytes) -> None:
        """Send one frame now; a bus that refuses it is counted, as on a real device."""
        try:
            self._frames.send_frame(can_id, data)
        except (can.CanError, OSError):
            self.send_errors += 1
        else:
            if self.far:
                self._arrivals.sent()
            self.frames_out += 1
