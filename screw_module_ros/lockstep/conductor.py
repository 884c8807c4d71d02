# SPDX-License-Identifier: Apache-2.0
"""Advances simulated time; only the process with the physics does so.

    while working:
        serve the buses
        due = conductor.quiet()
        if due is not None: conductor.move(...); timers of the devices; conductor.release()
        else: conductor.sleep()

The conductor stops waiting for a member that makes no progress for `PATIENCE_S` of wall clock while
others wait for it, or whose process has ended, until that member follows again. If that process
could run and the machine does not let it, as on a busy host of many machines, it has `STARVED_S`.
"""

from __future__ import annotations

import os
import time
from collections import defaultdict
from collections.abc import Callable, Iterator

from .page import BUSY, FOREVER, NOW, THREADS, Page, alive, works

PATIENCE_S = 1.0
STARVED_S = 10.0
_LOOK_S = 0.05  # wall clock between checks for processes that have ended
_ROLL_S = 1.0  # the same, while time advances
_MOST_AHEAD_S = 0.005  # largest delay that time catches up after a late tick


class ConductorExists(RuntimeError):
    """Another process already advances this time."""


class Conductor:
    """Advances the time of one page, whose header is `header`.

    speed: simulated seconds per second at most, 0 = as fast as possible. report: called with a
    message about members that the conductor no longer waits for.
    """

    def __init__(self, page: Page, speed: float, report: Callable[[str], None]):
        self._page, self.header = page, page.header
        self.speed = speed
        self._report = report
        with page.locked():
            if page.conductor and page.conductor != os.getpid() and alive(page.conductor):
                raise ConductorExists(
                    f"process {page.conductor} simulates this robot already: stop it first, or "
                    "start this one in another namespace or ROS domain"
                )
            page.conductor = os.getpid()
            page.changed()
        self._roster = -1
        self._top = 0
        self._is_new_roll = False
        self._seen = 0
        self._ends: list[tuple[int, list[int]]] = []  # with those that send to them
        self._buses: list[tuple[int, list[int]]] = []
        self.given_up = 0
        self._progress: tuple = ()
        self._progress_s = self._looked_s = self._called_s = time.monotonic()
        self._due_s = self._progress_s
        self._factor_s, self._factor_ns = self._progress_s, self.header[NOW]

    def quiet(self) -> int | None:
        """Return the earliest time a member waits for [ns]; None while any member has work."""
        page = self._page
        if self._roster != page.roster:
            self._refresh_members()
        top = self._top
        while True:
            waits = sum(page.waits[:top])
            if min(page.until[:top], default=FOREVER) <= self.header[NOW]:
                return None  # looked at first, because it is quick
            if next(self._in_transit(), None) is not None:
                return None
            # In this order: who has just taken what was in transit is busy before that.
            earliest = min(page.until[:top], default=FOREVER)
            if earliest <= self.header[NOW]:
                return None
            if sum(page.waits[:top]) == waits:
                return earliest

    def _in_transit(self) -> Iterator[int]:
        """Yield the ends that time waits for: something is in transit, and a thread waits there.

        This process takes whatever is sent to it on a bus. Its loops, where it has any, take from a
        topic at their next tick.
        """
        page, own = self._page, self._page.conductor
        follows, waiter, taken, sent = page.follows, page.waiter, page.taken, page.sent
        sends = page.sends
        for end, senders in self._ends:
            if follows[end] and (waiter[end] >= 0 or sends[end] and page.end_pid[end] == own):
                total = 0
                for sender in senders:
                    total += sent[sender]
                if taken[end] < total:
                    yield end

    def _refresh_members(self) -> None:
        page = self._page
        self._roster = page.roster
        self._top = 1 + max((i for i in range(THREADS) if page.thread_pid[i]), default=-1)
        senders: dict[int, list[int]] = defaultdict(list)
        channels = {row: channel for row, channel in enumerate(page.channel) if channel}
        for row, channel in channels.items():
            if page.sends[row]:
                senders[channel].append(row)
        ends = ((row, [each for each in senders[channels[row]] if each != row]) for row in channels)
        self._ends = [(end, others) for end, others in ends if others]
        self._buses = [(end, others) for end, others in self._ends if page.sends[end]]
        self._is_new_roll = True
        page.top = self._top

    def too_early(self) -> float:
        """Return how long to wait for the wall clock before time may advance [s], 0 = no wait."""
        return max(0.0, self._due_s - time.monotonic()) if self.speed else 0.0

    def move(self, to_ns: int) -> None:
        """Set the time; `release` then wakes the members."""
        page = self._page
        elapsed_s = (to_ns - self.header[NOW]) * 1e-9
        now_s = self._progress_s = time.monotonic()
        if self.speed:
            self._due_s = max(self._due_s, now_s - _MOST_AHEAD_S) + elapsed_s / self.speed
        for end, senders in self._ends if self._is_new_roll else self._buses:
            # One that left was taken from at the same moment, or lost frames came after all.
            page.taken[end] = min(page.taken[end], sum(page.sent[each] for each in senders))
        self._is_new_roll = False
        page.settled[:] = page.sent  # what was sent is of the past from here on
        self.header[NOW] = to_ns
        if now_s - self._factor_s > 1.0:
            page.factor = (to_ns - self._factor_ns) * 1e-9 / (now_s - self._factor_s)
            self._factor_s, self._factor_ns = now_s, to_ns

    def release(self) -> None:
        """Wake every member that waits for this time."""
        page, now_ns = self._page, self.header[NOW]
        until = page.until
        for thread in range(self._top):
            if BUSY < until[thread] <= now_ns:
                until[thread] = BUSY
                page.wake_thread(thread)

    def sleep(self, longest_s: float) -> bool:
        """Sleep until a member has changed its state since `look`, for `longest_s` at most.

        Return whether one has.
        """
        self._page.sleep_conductor(self._seen, min(longest_s, _LOOK_S))
        self._check_members()
        return self._page.header[4] != self._seen

    def look(self) -> None:
        """Record the changes so far; call it before `quiet`, so that `sleep` misses none."""
        self._seen = self.header[4]

    def _check_members(self) -> None:
        """Stop waiting for members that have ended, or that make no progress."""
        now_s = time.monotonic()
        if now_s - self._looked_s < _LOOK_S:
            return
        self._looked_s = now_s
        progress = self._busy_now()
        stands = progress == self._progress
        if stands or now_s - self._called_s > _ROLL_S:
            self._called_s = now_s
            self._dismiss_ended()
        if not stands:
            self._progress, self._progress_s = progress, now_s
            return
        stood_s = now_s - self._progress_s
        if stood_s > STARVED_S or stood_s > PATIENCE_S and not self._starves():
            self._progress_s = now_s
            self._give_up(stood_s)

    def _starves(self) -> bool:
        """Return whether a process that holds time could run."""
        page = self._page
        holding = {page.thread_pid[thread] for thread in self._busy_threads()}
        holding |= {page.end_pid[end] for end in self._in_transit()}
        return any(works(pid) for pid in holding - {0})

    def _busy_threads(self) -> list[int]:
        page, now_ns = self._page, self.header[NOW]
        return [thread for thread in range(self._top) if page.until[thread] <= now_ns]

    def _busy_now(self) -> tuple:
        """Return the time and the number of waits of each busy thread; constant while it hangs.

        Waiting threads repeat their declaration now and then; that is no progress.
        """
        waits = self._page.waits
        return (self.header[NOW], *((thread, waits[thread]) for thread in self._busy_threads()))

    def _dismiss_ended(self) -> None:
        page = self._page
        pids = {*page.user_pid} - {0}
        for pid in pids:
            if not alive(pid):
                with page.locked():
                    page.dismiss(pid)

    def _give_up(self, stood_s: float) -> None:
        page = self._page
        names = []
        for thread in self._busy_threads():
            page.until[thread] = FOREVER
            names.append(page.name(thread))
        for end in [*self._in_transit()]:
            waiter = page.waiter[end]
            names.append(f"{page.name(waiter) if waiter >= 0 else 'the rig'} (not received)")
            page.follows[end] = 0
        if names:
            self.given_up += len(names)
            self._report(
                f"simulated time no longer waits for {', '.join(names)}: no progress for "
                f"{stood_s:.0f} s"
            )

    def close(self) -> None:
        """Stop the time."""
        with self._page.locked():
            if self._page.conductor == os.getpid():
                self._page.conductor = 0
