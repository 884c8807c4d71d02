# SPDX-License-Identifier: Apache-2.0
"""The one clock: every loop, driver, guard and client takes the time from here.

`WallClock` is CLOCK_MONOTONIC, for hardware. `SimulatedClock` is the time of the simulated rig
(see `lockstep`). The owner of a `ManualClock` advances it, for loops in a single thread. Laws,
limits and guards work with any of them.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import contextmanager
from typing import Any, Protocol

from .domain import domain_id
from .lockstep.member import Member, TimeStandsStill
from .lockstep.page import Page, alive, page_name
from .lockstep.wires import Hop, Line, Source

__all__ = [
    "Arrivals", "Clock", "ManualClock", "SimulatedClock", "TimeStandsStill", "WallClock",
    "simulated_clock",
]  # fmt: skip

_POLL_NS = 1_000_000
_STANDS_STILL_S = 2.0
_LOST_S = 0.2  # wall clock after which a sent frame counts as lost


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

    simulated: time advances in steps and may be slower than real time.
    """

    simulated = False

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

    def arrivals(self, bus: Any) -> Arrivals:
        """Return the arrivals of an open python-can bus."""
        return _Plain(self, bus)

    def idle(self) -> None:
        """Tell that this thread has nothing to do with time from here on."""

    def leave(self) -> None:
        """Tell that this thread has ended."""

    def close(self) -> None:
        """Release the clock."""

    @contextmanager
    def working(self):
        """Hold simulated time while this thread works, except in its waits."""
        yield


class _Plain:
    """Arrivals of a bus that does its own waiting."""

    def __init__(self, clock: Clock, bus: Any):
        self._clock, self._bus = clock, bus

    def receive(self, until_ns: int) -> Any:
        left_ns = until_ns - self._clock.now_ns() if until_ns else 0
        return self._bus.recv(left_ns * 1e-9 if left_ns > 0 else 0.0)

    def expects(self) -> bool:
        return True

    def sent(self) -> None:
        pass

    def close(self) -> None:
        pass


class WallClock(Clock):
    """CLOCK_MONOTONIC; stamps are the system clock's."""

    now_ns = staticmethod(time.monotonic_ns)
    stamp_ns = staticmethod(time.time_ns)

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

    def arrivals(self, bus: Any) -> Arrivals:
        """Return the arrivals of a bus; a wait for a frame ends at once."""
        return _Unawaited(self, bus)


class _Unawaited(_Plain):
    def receive(self, until_ns: int) -> Any:
        message = self._bus.recv(0.0)
        if message is None and until_ns:
            self._clock.sleep_until(until_ns)
        return message


class SimulatedClock(Clock):
    """The rig's time. Each waiting thread is a separate member, from its first wait on.

    name: of this process in the conductor's messages. stopping: returns whether the process shall
    end; with it the main thread waits for time without limit. None: every wait has a limit.
    """

    simulated = True

    def __init__(self, page: Page, name: str, stopping: Callable[[], bool] | None = None):
        self.page = page
        self.name = name
        self._has_loop = stopping is not None
        self.stopping = stopping or (lambda: False)
        self._own = threading.local()
        self._users = 0

    def now_ns(self) -> int:
        """Return simulated time [ns]."""
        return self.page.header[1]

    stamp_ns = now_ns

    @property
    def member(self) -> Member:
        """This thread's membership in simulated time."""
        try:
            return self._own.member
        except AttributeError:
            thread = threading.current_thread()
            is_loop = self._has_loop and thread is threading.main_thread()
            self._own.member = Member(
                self.page, f"{self.name}/{thread.name}", self.stopping,
                None if is_loop else _STANDS_STILL_S,
            )  # fmt: skip
            return self._own.member

    @property
    def has_rig(self) -> bool:
        """Whether the process that advances this time exists, stopped or not."""
        return alive(self.page.conductor)

    def sleep_until(self, due_ns: int) -> None:
        """Return when it is `due_ns`. Raises TimeStandsStill."""
        self.member.wait(due_ns)

    def arrivals(self, bus: Any) -> Arrivals:
        """Return the arrivals of a bus that counts its members' frames."""
        return _Counted(self, bus) if hasattr(bus, "members_frames") else _Plain(self, bus)

    def source(self, topic: str) -> Source:
        """Return the publishing end of a topic (full name)."""
        return Source(self.page, topic)

    def hop(self, topic: str) -> Hop:
        """Return a receiving end of a topic (full name)."""
        return Hop(self.page, topic)

    def idle(self) -> None:
        """Tell that this thread has nothing to do with time from here on."""
        self.member.idle()

    def leave(self) -> None:
        """Tell that this thread has ended."""
        member = self.__dict__["_own"].__dict__.pop("member", None)
        if member is not None:
            member.leave()

    @contextmanager
    def working(self):
        """Hold time while this thread works, except in its waits."""
        member = self.member
        member.busy()
        try:
            yield
        finally:
            member.idle()

    def close(self) -> None:
        """Close the page; effective with the call of the last user in this process."""
        with _opening:
            self._users -= 1
            if self._users > 0:
                return
            for name in [name for name, clock in _opened.items() if clock is self]:
                del _opened[name]
                self.page.close()


class _Counted:
    """A bus whose frames hold simulated time until they are read."""

    def __init__(self, clock: SimulatedClock, bus: Any):
        self._clock, self._bus = clock, bus
        self.line = Line(clock.page, bus.members_bus)

    def receive(self, until_ns: int) -> Any:
        """Return the next frame; wait for it until `until_ns`, None without one."""
        if until_ns and self.line.pending() <= 0:
            self._clock.member.wait(until_ns, self.line)
        message = self._bus.recv(0.0)
        if message is None and self.line.pending() > 0:
            message = self._bus.recv(_LOST_S)  # the kernel may take a moment
            if message is None:
                self.line.forgive(self.line.pending())
        self.line.handled(self._bus.members_frames)
        return message

    def expects(self) -> bool:
        """Return whether a frame of another member is in transit."""
        return self.line.pending() > 0

    def sent(self) -> None:
        self.line.sent()

    def close(self) -> None:
        self.line.close()


_opened: dict[str, SimulatedClock] = {}
_opening = threading.Lock()


def simulated_clock(
    name: str, namespace: str, stopping: Callable[[], bool] | None = None
) -> SimulatedClock:
    """Return this process's clock for the robot in `namespace` and the process's ROS domain.

    Each caller must call `close` on it.
    """
    found = page_name(str(domain_id()), namespace)
    with _opening:
        if found not in _opened:
            _opened[found] = SimulatedClock(Page(found), name, stopping)
        clock = _opened[found]
        clock._users += 1
        return clock
