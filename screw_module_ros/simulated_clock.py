# SPDX-License-Identifier: Apache-2.0
"""The clock of the simulated rig: every process of the robot reads the same time (see `lockstep`).

A thread that uses it holds the time while it works; the time advances while all threads wait.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import contextmanager
from typing import Any

from .clock import Arrivals, Clock, PlainArrivals
from .domain import domain_id
from .lockstep.member import Member
from .lockstep.page import Page, alive, page_name
from .lockstep.wires import Hop, Line, Source

_STANDS_STILL_S = 2.0
_LOST_S = 0.2  # wall clock after which a sent frame counts as lost


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
        counts = hasattr(bus, "members_frames")
        return _CountedArrivals(self, bus) if counts else PlainArrivals(self, bus)

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


class _CountedArrivals:
    """Arrivals of a bus whose frames hold simulated time until they are read."""

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
