# SPDX-License-Identifier: Apache-2.0
"""The clock of the simulated rig: every process of the robot reads the same time (see `lockstep`).

A thread that uses it holds the time while it works; the time advances while all threads wait.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from ..clock import Arrivals, Clock, PlainArrivals, Serving
from ..domain import domain_id
from .end import End
from .member import Member
from .page import NOW, Page, alive, page_name

_STANDS_STILL_S = 2.0
_PASSED_ON_S = 0.2  # wall clock after which a frame is not on its way through the rig


class SimulatedClock(Clock):
    """The rig's time. Each waiting thread is a separate member, from its first wait on.

    name: of this process in the conductor's messages. stopping: returns whether the process shall
    end; with it the main thread waits for time without limit. None: every wait has a limit.
    rounds: the loops of the process, where its main thread runs them all.
    """

    simulated = True
    rounds: Any = None

    def __init__(self, page: Page, name: str, stopping: Callable[[], bool] | None = None):
        self.page = page
        self.name = name
        self._has_loop = stopping is not None
        self.stopping = stopping or (lambda: False)
        self._own = threading.local()
        self._users = 0

    def now_ns(self) -> int:
        """Return simulated time [ns]."""
        return self.page.header[NOW]

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

    def arrivals(self, frames: Any) -> Arrivals:
        """Return the arrivals of a bus that counts its members' frames."""
        counts = hasattr(frames, "frames_counted")
        return (_CountedArrivals if counts else PlainArrivals)(self, frames)

    def publisher(self, topic: str) -> End:
        """Return the publishing end of a topic (full name)."""
        return End(self.page, topic, sends=True, numbered=True)

    def subscription(self, topic: str) -> End:
        """Return a receiving end of a topic (full name)."""
        return End(self.page, topic)

    def serving(self, node: str) -> Serving:
        """Return what holds simulated time for the requests to a node (full name)."""
        return _CountedServing(self, node)

    def calls(self, node: str) -> Calls:
        """Return what holds simulated time for a client's requests to a node (full name)."""
        return Calls(self.page, node)

    def idle(self) -> None:
        """Tell that this thread has nothing to do with time from here on."""
        self.member.idle()

    def leave(self) -> None:
        """Tell that this thread has ended."""
        member = self.__dict__["_own"].__dict__.pop("member", None)
        if member is not None:
            member.leave()

    @contextmanager
    def working(self) -> Iterator[None]:
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
        self._end = End(clock.page, f"bus {bus.channel_info}", sends=True, follows=True)
        bus.counted = True
        self._read = bus.frames_counted
        self.close = self._end.close

    def receive(self, until_ns: int) -> Any:
        """Return the next frame; wait for it until `until_ns`, None without one."""
        if until_ns and not self._end.pending:
            self._clock.member.wait(until_ns, (self._end,))
        frame = self._bus.receive_frame(0.0)
        if frame is None:
            lost = not self._end.follows  # it was given up, and has now read everything
            if self._end.pending:
                frame = self._bus.receive_frame(_PASSED_ON_S)  # of another driver: the rig passes
                lost = True
            if frame is None and lost:
                self._end.catch_up()
        if self._bus.frames_counted != self._read:
            self._read = self._bus.frames_counted
            self._end.take_next()
        return frame

    def expects(self) -> bool:
        """Return whether a frame of another member is in transit."""
        return self._end.pending

    def sent(self) -> None:
        """Count a frame that the bus has accepted: one that is counted is there to be read."""
        self._end.count()
        self._end.announce()


class _CountedServing(Serving):
    """The end of the node: see `clock.Serving`."""

    def __init__(self, clock: SimulatedClock, node: str):
        self._clock = clock
        self._requests = End(clock.page, _requests_to(node))
        self._answers = End(clock.page, _answers_of(node), sends=True, numbered=True)
        self._server: Member | None = None
        self._requests.hold(clock.member.row)
        clock.idle()

    @contextmanager
    def working(self) -> Iterator[None]:
        """Hold time while this thread works, except in its waits, in which requests wait too."""
        self._server = self._clock.member
        with self._clock.working(), self._requests.paused():
            yield

    @contextmanager
    def answering(self) -> Iterator[None]:
        """Like `working`, for one request, whose client has the answer before time advances."""
        with self.working():
            yield
            self._answers.count()
            self._requests.catch_up()
        self._answers.announce()

    def hold(self) -> None:
        """Hold time for the thread that serves until it has worked once more."""
        if self._server is not None:
            self._server.busy()

    def close(self) -> None:
        """Hold nothing from now on: nothing is served any more."""
        self._requests.stop_following()
        server, self._server = self._server, None
        if server is not None:
            server.idle()


class Calls:
    """The end of a client: its requests hold time until they are served, answers until they came.

    answer: pending when the node has answered.
    """

    def __init__(self, page: Page, node: str):
        self._request = End(page, _requests_to(node), sends=True)
        self.answer = End(page, _answers_of(node))

    def begin(self) -> None:
        """Count a request that is about to be sent."""
        self.answer.catch_up()
        self._request.count()

    def close(self) -> None:
        """Return the rows."""
        self._request.close()
        self.answer.close()


def _requests_to(node: str) -> str:
    return f"request {node}"


def _answers_of(node: str) -> str:
    return f"answer {node}"


_opened: dict[str, SimulatedClock] = {}
_opening = threading.Lock()


_kind: type[SimulatedClock] = SimulatedClock


def use(kind: type[SimulatedClock]) -> None:
    """Let the clocks that this process opens from now on be of a kind."""
    global _kind
    _kind = kind


def simulated_clock(
    name: str, namespace: str, stopping: Callable[[], bool] | None = None
) -> SimulatedClock:
    """Return this process's clock for the robot in `namespace` and the process's ROS domain.

    Each caller must call `close` on it.
    """
    found = page_name(str(domain_id()), namespace)
    with _opening:
        if found not in _opened:
            _opened[found] = _kind(Page(found), name, stopping)
        clock = _opened[found]
        clock._users += 1
        return clock
