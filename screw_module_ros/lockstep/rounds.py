# SPDX-License-Identifier: Apache-2.0
"""All loops of a simulated robot in one thread, each as a greenlet: no tick switches threads.

A wait of a loop parks its greenlet and returns to the hub, the thread's own greenlet, which moves
the time. So steps, drivers and tickers are those of the separate processes, and a loop that waits
for a silent device lets the others run meanwhile::

    hub: the rig serves what was sent -> each loop that is ready, in the order of their start
         nobody is ready: time moves to the earliest wait (`rig.Rig.turn`)

The other threads of the process, which serve its nodes, are members of simulated time as ever.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from threading import get_ident
from typing import Any

from greenlet import getcurrent, greenlet

from ..clock import Arrivals, TimeStandsStill
from .clock import SimulatedClock
from .member import Member
from .page import FOREVER, NOBODY, NOW, Page

_LOOK_S = 0.005  # wall clock between two looks of a loop that rests
_LOCK_NS = 1_000_000
_monotonic_s = time.monotonic


class _Loop:
    """A loop: its greenlet, the time that it waits for [ns], what ends its wait before that.

    look_s: while it rests, the wall clock of its next look.
    """

    __slots__ = ("greenlet", "look_s", "queues", "until_ns")

    def __init__(self, run: Callable[[], object], hub: greenlet):
        self.greenlet = greenlet(run, hub)
        self.until_ns = 0
        self.queues: Sequence[Any] = ()
        self.look_s = 0.0


class Rounds:
    """The loops of one thread, which makes this object; its greenlet is the hub.

    turn: moves the time for a wait of the hub itself, called with the time that it waits for [ns].
    serve: lets the rig answer what was sent, called with the time [ns]. holds: returns whether time
    waits for a frame within this process. earliest_ns: of the loops' waits, after `run_ready`.
    """

    def __init__(self) -> None:
        self._hub = getcurrent()
        self._loops: list[_Loop] = []
        self._by_greenlet: dict[Any, _Loop] = {}
        self.stand_still()
        self.holds: Callable[[], bool] = lambda: False
        self.earliest_ns = FOREVER

    def stand_still(self) -> None:
        """Have nobody who moves the time and answers frames."""
        self.turn: Callable[[int], object] | None = None
        self.serve: Callable[[int], object] = lambda now_ns: None

    def add(self, run: Callable[[], object]) -> None:
        """Add a loop; it begins with the next round and is forgotten when it returns."""
        loop = _Loop(run, self._hub)
        self._loops.append(loop)
        self._by_greenlet[loop.greenlet] = loop

    @property
    def ended(self) -> bool:
        """Whether every loop has returned."""
        return not self._loops

    def run_ready(self, now_ns: int) -> bool:
        """Run each loop that is ready, in the order of their start; return whether any was.

        Raises what a loop raises.
        """
        ran = ended = False
        earliest_ns = FOREVER
        for loop in self._loops:
            if loop.until_ns > now_ns:
                for queue in loop.queues:
                    if queue:
                        break
                else:
                    if not loop.look_s or _monotonic_s() < loop.look_s:
                        earliest_ns = min(earliest_ns, loop.until_ns)
                        continue
            loop.greenlet.switch()
            ran = True
            ended |= loop.greenlet.dead
        self.earliest_ns = earliest_ns
        if ended:
            self._forget_ended()
        return ran

    def _forget_ended(self) -> None:
        self._loops = [loop for loop in self._loops if not loop.greenlet.dead]
        self._by_greenlet = {loop.greenlet: loop for loop in self._loops}

    def wait(self, until_ns: int, queues: Sequence[Any] = ()) -> bool:
        """Park the calling loop until `until_ns`, or until one of `queues` has something in it.

        Return False, without a wait, in the hub: its own waits move the time.
        """
        loop = self._by_greenlet.get(getcurrent())
        if loop is None:
            return False
        loop.until_ns, loop.queues = until_ns, queues
        self._hub.switch()
        return True

    def rest(self) -> bool:
        """Park the calling loop for a moment of wall clock, like `wait`; it holds no time."""
        loop = self._by_greenlet.get(getcurrent())
        if loop is None:
            return False
        loop.until_ns, loop.queues, loop.look_s = FOREVER, (), _monotonic_s() + _LOOK_S
        self._hub.switch()
        loop.look_s = 0.0
        return True

    def end(self, why: str) -> None:
        """End the loops that still wait, by TimeStandsStill with `why`: no time comes any more."""
        for loop in self._loops:
            if loop.greenlet:  # else it has not begun yet
                loop.greenlet.throw(TimeStandsStill(why))
        self._loops, self._by_greenlet = [], {}


class RoundsClock(SimulatedClock):
    """The rig's time in its own process, whose main thread runs all loops in `rounds`.

    It is opened by the main thread. buses: those that the rig serves here, by channel. main: the
    number of that thread.
    """

    rounds: Rounds

    def __init__(self, page: Page, name: str, stopping: Callable[[], bool] | None = None):
        super().__init__(page, name, stopping)
        self.main = get_ident()
        self.rounds = Rounds()
        self.buses: dict[str, Any] = {}
        self.rounds.holds = self._holds
        self._near: list[MemberFrames] = []
        self._own.member = _MainMember(page, f"{name}/loops", self)

    def sleep_until(self, due_ns: int) -> None:
        """Return when it is `due_ns`. Raises TimeStandsStill."""
        if get_ident() != self.main:
            self.member.wait(due_ns)
        elif self.page.header[NOW] < due_ns and not self.rounds.wait(due_ns):
            self._move(due_ns, ())

    def await_any(self, until_ns: int, queues: Sequence[Any]) -> None:
        """Wait in the main thread until `until_ns`, or for something in one of `queues`."""
        if self.page.header[NOW] < until_ns and not self.rounds.wait(until_ns, queues):
            self._move(until_ns, queues)

    def await_frame(self, until_ns: int, at: MemberFrames) -> bool:
        """Wait until `until_ns`, or for a frame; the rig answers before a wait of the main thread.

        Return True: the bus may also have ended. Raises TimeStandsStill.
        """
        if get_ident() != self.main:
            self.member.wait(until_ns, (at,))
        else:
            self.rounds.serve(self.page.header[NOW])
            if not at.queue:
                self.await_any(until_ns, (at.queue,))
        return True

    def _move(self, until_ns: int, queues: Sequence[Any]) -> None:
        header, rounds = self.page.header, self.rounds
        while header[NOW] < until_ns and not any(queues):
            if rounds.turn is None:
                raise TimeStandsStill("simulated time stands still: sim_rig has stopped")
            rounds.turn(until_ns)

    def rest(self, ended: threading.Event, seconds: float) -> None:
        """Wait by wall clock until `ended` is set, for `seconds` at most, without holding time."""
        if get_ident() != self.main or not self.rounds.rest():
            super().rest(ended, seconds)

    def acquire(self, lock: threading.Lock) -> None:
        """Take a lock that another thread may hold in a wait for time; the other loops go on."""
        if get_ident() != self.main:
            lock.acquire()
            return
        while not lock.acquire(blocking=False):
            self.await_any(self.page.header[NOW] + _LOCK_NS, (_Released(lock),))

    def arrivals(self, frames: Any) -> Arrivals:
        """Return the arrivals of a bus: of one that is served here, what passes by calls."""
        if hasattr(frames, "join") or not hasattr(frames, "queue"):
            return super().arrivals(frames)
        near = MemberFrames(self, frames)
        self._near = [*self._near, near]
        return near

    def forget(self, closed: MemberFrames) -> None:
        """Forget the arrivals of a bus."""
        self._near = [each for each in self._near if each is not closed]

    def _holds(self) -> bool:
        """Return whether a frame waits for the rig, or for a thread that waits for it and is woken.

        A frame for a loop does not: it may read that later.
        """
        for hub in self.buses.values():
            if hub.queue:
                return True
        waiter = self.page.waiter
        for near in self._near:
            if near.queue and waiter[near.row] >= 0:
                self.page.wake_thread(waiter[near.row])
                return True
        return False


class _Released:
    """Something to wait for: true while nobody holds a lock."""

    def __init__(self, lock: threading.Lock):
        self._lock = lock

    def __bool__(self) -> bool:
        return not self._lock.locked()


class NearFrames:
    """Frames of the other ends of a bus in the same process, which pass by calls.

    clock: its `await_frame` lets the rig answer, waits, and returns whether to look for a frame.
    """

    def __init__(self, clock: Any, bus: Any):
        self._clock, self._bus, self.queue = clock, bus, bus.queue
        self.expects = self.queue.__len__

    def receive(self, until_ns: int) -> Any:
        """Return the next frame; wait for it until `until_ns`, None without one."""
        queue = self.queue
        if not queue and until_ns and not self._clock.await_frame(until_ns, self):
            return None
        return queue.popleft() if queue else self._bus.receive_frame(0.0)

    def sent(self) -> None:
        """Do nothing: who waits for the frame looks for it."""

    def close(self) -> None:
        """Do nothing: the caller closes the bus."""


class MemberFrames(NearFrames):
    """Those for a member of the rig's bus, which any thread of the process may use."""

    _clock: RoundsClock

    def __init__(self, clock: RoundsClock, bus: Any):
        super().__init__(clock, bus)
        page = clock.page
        with page.locked():
            self.row = page.take(page.end_pid, "bus, topic or service")
            # A channel of its own, in which nothing is counted: the rig here does answer.
            page.channel[self.row], page.waiter[self.row] = -1 - self.row, NOBODY
            page.sent[self.row] = 1

    @property
    def pending(self) -> bool:
        """Whether a frame waits."""
        return bool(self.queue)

    def sent(self) -> None:
        """Wake the main thread for a frame of another one: it serves the rig."""
        if get_ident() != self._clock.main:
            self._clock.page.wake_conductor()

    def close(self) -> None:
        """Return the row."""
        self._clock.forget(self)
        with self._clock.page.locked():
            self._clock.page.leave(self.row)


class _MainMember(Member):
    """The main thread in the page: it holds no time there, because it moves the time itself."""

    def __init__(self, page: Page, name: str, clock: RoundsClock):
        super().__init__(page, name, lambda: False)
        page.until[self.row] = FOREVER
        self._clock = clock

    def busy(self) -> None:
        """Do nothing: while this thread works, nobody moves the time."""

    def idle(self) -> None:
        """Do nothing: see `busy`."""

    def wait(self, until_ns: int, ends: Sequence[Any] = ()) -> None:
        """Wait until `until_ns`, or until one of `ends` is not empty. Raises TimeStandsStill."""
        if self._page.header[NOW] < until_ns and not any(ends):
            self._clock.await_any(until_ns, ends)
