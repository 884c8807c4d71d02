# SPDX-License-Identifier: Apache-2.0
"""The one clock: every loop, driver, guard and client takes the time from here.

`WallClock` is CLOCK_MONOTONIC, for hardware. `SimulatedClock` is the time of the simulated rig
(see `lockstep`). `ManualClock` is moved by its owner: for loops that run in one thread. No law,
limit or guard knows which it has.
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
_LOST_S = 0.2  # wall clock: a frame that was sent and has not come by then is lost


class Arrivals(Protocol):
    """What comes in on one bus."""

    def receive(self, until_ns: int) -> Any:
        """Return the next frame, waiting for it until `until_ns` at most; None without one."""

    def expects(self) -> bool:
        """Return whether a frame is under way; True where that cannot be known."""

    def sent(self) -> None:
        """Note a frame that the bus has taken."""

    def close(self) -> None:
        """Note nothing more."""


class Clock:
    """What there is to ask of a clock; times in ns, comparable within one robot.

    simulated: time stands still between two steps and may be slower than real time.
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
        """Let `seconds` pass."""
        self.sleep_until(self.now_ns() + round(seconds * 1e9))

    def wait_for(self, condition: Callable[[], object], seconds: float) -> bool:
        """Wait until `condition()`, or for `seconds`; return whether it came to that."""
        deadline_ns = self.now_ns() + round(seconds * 1e9)
        while not condition():
            now_ns = self.now_ns()
            if now_ns >= deadline_ns:
                return False
            self.sleep_until(min(deadline_ns, now_ns + _POLL_NS))
        return True

    def arrivals(self, bus: Any) -> Arrivals:
        """Return what is heard on an open python-can bus."""
        return _Plain(self, bus)

    def idle(self) -> None:
        """Tell that this thread has nothing to do with time from here on."""

    def leave(self) -> None:
        """Tell that this thread has ended."""

    def close(self) -> None:
        """Take no more part in the time."""

    @contextmanager
    def working(self):
        """Hold simulated time while this thread works, except in its waits."""
        yield


class _Plain:
    """A bus waited for with its own means."""

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
    """Time that its owner moves. A wait ends at once, at the time that it wanted."""

    simulated = True

    def __init__(self, now_ns: int = 0):
        self.time_ns = now_ns

    def now_ns(self) -> int:
        """Return the time [ns]."""
        return self.time_ns

    stamp_ns = now_ns

    def sleep_until(self, due_ns: int) -> None:
        """Move the time to `due_ns`."""
        self.time_ns = max(self.time_ns, due_ns)

    def arrivals(self, bus: Any) -> Arrivals:
        """Return what is heard on a bus; what is not there now is not there until the end."""
        return _Unawaited(self, bus)


class _Unawaited(_Plain):
    def receive(self, until_ns: int) -> Any:
        message = self._bus.recv(0.0)
        if message is None and until_ns:
            self._clock.sleep_until(until_ns)
        return message


class SimulatedClock(Clock):
    """The rig's time. Each thread that waits is a member of its own, from its first wait on.

    name: how the conductor calls this process. stopping: whether it is to end, for a process whose
    main thread waits for time to move on however long that takes; None: no thread waits for ever.
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
        """This thread's part in the time."""
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
        """Whether the process that moves this time is there, stopped or not."""
        return alive(self.page.conductor)

    def sleep_until(self, due_ns: int) -> None:
        """Return when it is `due_ns`. Raises TimeStandsStill."""
        self.member.wait(due_ns)

    def arrivals(self, bus: Any) -> Arrivals:
        """Return what is heard on a bus that counts its members' frames."""
        return _Counted(self, bus) if hasattr(bus, "members_frames") else _Plain(self, bus)

    def source(self, topic: str) -> Source:
        """Return the publishing end of a topic; its full name."""
        return Source(self.page, topic)

    def hop(self, topic: str) -> Hop:
        """Return a receiving end of a topic; its full name."""
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
        """Leave the page, all threads of this process together, with the last user's call."""
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
        """Return the next frame, waiting until `until_ns`; None without one."""
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
        """Return whether a frame of another member is under way."""
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
    """Return this process's clock of the robot in `namespace` and the ROS domain it is in.

    Each who asks for it calls its `close`.
    """
    found = page_name(str(domain_id()), namespace)
    with _opening:
        if found not in _opened:
            _opened[found] = SimulatedClock(Page(found), name, stopping)
        clock = _opened[found]
        clock._users += 1
        return clock
