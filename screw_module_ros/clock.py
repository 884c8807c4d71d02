# SPDX-License-Identifier: Apache-2.0
"""Clocks: every loop, driver, guard and client takes the time from one of them.

`WallClock` is CLOCK_MONOTONIC, for hardware. The owner of a `ManualClock` advances it, for loops in
a single thread. `lockstep.clock.SimulatedClock` is the time of the simulated rig. Laws, limits and
guards work with any of them.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from types import MappingProxyType
from typing import Any, Protocol

_POLL_NS = 1_000_000


class TimeStandsStill(RuntimeError):
    """Simulated time does not advance; the message names what is missing."""


class Arrivals(Protocol):
    """Incoming frames of one bus."""

    def receive(self, until_ns: int) -> Any:
        """Return the next frame; wait for it until `until_ns` at most, None without one."""

    def expects(self) -> bool:
        """Return whether a frame is in transit; True if that is unknown."""

    def sent(self) -> None:
        """Count a frame that the bus has accepted."""

    def close(self) -> None:
        """Stop counting."""


class Clock:
    """Interface of a clock; times in ns, comparable within one robot.

    simulated: time advances in steps and may be slower than real time. work_ns: processor time that
    the calling thread has used [ns], None where time stands still meanwhile. buses: channel -> hub,
    of those that are served in this process.
    """

    simulated = False
    buses: Mapping[str, Any] = MappingProxyType({})
    work_ns: Callable[[], int] | None = None

    def now_ns(self) -> int:
        """Return the time: monotonic [ns]."""
        raise NotImplementedError

    def stamp_ns(self) -> int:
        """Return ROS time, for header stamps [ns]."""
        raise NotImplementedError

    def sleep_until(self, due_ns: int) -> None:
        """Return when it is `due_ns`."""
        raise NotImplementedError

    def sleep(self, seconds: float) -> None:
        """Wait for `seconds`."""
        self.sleep_until(self.now_ns() + round(seconds * 1e9))

    def wait_for(self, condition: Callable[[], object], seconds: float) -> bool:
        """Wait until `condition()`, for `seconds` at most; return whether it became true."""
        deadline_ns = self.now_ns() + round(seconds * 1e9)
        while not condition():
            now_ns = self.now_ns()
            if now_ns >= deadline_ns:
                return False
            self.sleep_until(min(deadline_ns, now_ns + _POLL_NS))
        return True

    def arrivals(self, frames: Any) -> Arrivals:
        """Return the arrivals of a bus; frames: of `can_io.frames.frames_of`."""
        return PlainArrivals(self, frames)

    def idle(self) -> None:
        """Tell that this thread has nothing to do with time from here on."""

    def rest(self, ended: threading.Event, seconds: float) -> None:
        """Wait by wall clock until `ended` is set, for `seconds` at most, without holding time."""
        self.idle()
        ended.wait(seconds)

    def acquire(self, lock: threading.Lock) -> None:
        """Take a lock, also one that another thread may hold in a wait for time."""
        lock.acquire()

    def leave(self) -> None:
        """Tell that this thread has ended."""

    def close(self) -> None:
        """Release the clock."""

    def working(self) -> AbstractContextManager:
        """Hold simulated time while this thread works, except in its waits."""
        return nullcontext()

    def serving(self, node: str) -> Serving:
        """Return what holds simulated time for the requests to a node (full name)."""
        return Serving()


class Serving:
    """Requests to a node, for the threads that serve it; by wall clock they hold nothing."""

    def working(self) -> AbstractContextManager:
        """Hold time while this thread works, except in its waits, in which requests wait too."""
        return nullcontext()

    def answering(self) -> AbstractContextManager:
        """Like `working`, for one request, whose client has the answer before time advances."""
        return nullcontext()

    def hold(self) -> None:
        """Hold time for the thread that serves until it has worked once more."""

    def close(self) -> None:
        """Hold nothing from now on: nothing is served any more."""


class PlainArrivals:
    """Arrivals of a bus that does its own waiting."""

    def __init__(self, clock: Clock, frames: Any):
        self._clock, self._frames = clock, frames

    def receive(self, until_ns: int) -> Any:
        """Return the next frame; wait for it until `until_ns` at most, None without one."""
        left_ns = until_ns - self._clock.now_ns() if until_ns else 0
        return self._frames.receive_frame(left_ns * 1e-9 if left_ns > 0 else 0.0)

    def expects(self) -> bool:
        """Return True: frames in transit are unknown."""
        return True

    def sent(self) -> None:
        """Do nothing: sent frames are not counted."""

    def close(self) -> None:
        """Do nothing: the caller closes the bus."""


class WallClock(Clock):
    """CLOCK_MONOTONIC; stamps are the system clock's."""

    now_ns = staticmethod(time.monotonic_ns)
    stamp_ns = staticmethod(time.time_ns)
    work_ns = staticmethod(time.thread_time_ns)

    def sleep_until(self, due_ns: int) -> None:
        """Return when it is `due_ns`."""
        left_ns = due_ns - time.monotonic_ns()
        if left_ns > 0:
            time.sleep(left_ns * 1e-9)


class ManualClock(Clock):
    """Time that its owner advances. A wait sets the time to its end and returns at once."""

    simulated = True

    def __init__(self, now_ns: int = 0):
        self.time_ns = now_ns

    def now_ns(self) -> int:
        """Return the time [ns]."""
        return self.time_ns

    stamp_ns = now_ns

    def sleep_until(self, due_ns: int) -> None:
        """Advance the time to `due_ns`."""
        self.time_ns = max(self.time_ns, due_ns)

    def arrivals(self, frames: Any) -> Arrivals:
        """Return the arrivals of a bus; a wait for a frame ends at once."""
        return _Unawaited(self, frames)


class _Unawaited(PlainArrivals):
    def receive(self, until_ns: int) -> Any:
        frame = self._frames.receive_frame(0.0)
        if frame is None and until_ns:
            self._clock.sleep_until(until_ns)
        return frame
