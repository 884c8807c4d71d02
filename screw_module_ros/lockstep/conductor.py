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
from collections.abc import Callable

from .page import BUSY, FOREVER, HOPS, LINES, NOBODY, SLOTS, Page, alive, works
from .wires import Line

PATIENCE_S = 1.0
STARVED_S = 10.0
_LOOK_S = 0.05  # wall clock between checks for processes that have ended
_ROLL_S = 1.0  # the same, while time advances
_MOST_AHEAD_S = 0.005  # largest delay that time catches up after a late tick


class TimeTaken(RuntimeError):
    """Another process already advances this time."""


class Conductor:
    """Advances the time of one page.

    speed: simulated seconds per second at most, 0 = as fast as possible. report: called with a
    message about members that the conductor no longer waits for.
    """

    def __init__(self, page: Page, speed: float, report: Callable[[str], None]):
        self._page = page
        self.speed = speed
        self._report = report
        with page.locked():
            if page.conductor and page.conductor != os.getpid() and alive(page.conductor):
                raise TimeTaken(
                    f"process {page.conductor} simulates this robot already: stop it first, or "
                    "start this one in another namespace or ROS domain"
                )
            page.conductor = os.getpid()
            page.changed()
        self._roster = -1
        self._top = 0
        self._seen = 0
        self._lines: list[Line] = []
        self._hops: list[tuple[int, int]] = []
        self.given_up = 0
        self._progress: tuple = ()
        self._progress_s = self._looked_s = self._called_s = time.monotonic()
        self._due_s = self._progress_s
        self._factor_s, self._factor_ns = self._progress_s, page.now_ns

    @property
    def now_ns(self) -> int:
        """Simulated time [ns]."""
        return self._page.now_ns

    def quiet(self) -> int | None:
        """Return the earliest time a member waits for [ns]; None while any member has work."""
        page = self._page
        if self._roster != page.roster:
            self._call_roll()
        top = self._top
        while True:
            declared = sum(page.slot_declared[:top])
            if self._under_way():
                return None
            earliest = min(page.slot_until[:top], default=FOREVER)
            if earliest <= page.now_ns:
                return None
            if sum(page.slot_declared[:top]) == declared:
                return earliest

    def _under_way(self) -> bool:
        page = self._page
        for line in self._lines:
            if self._is_awaited(line) and line.pending() > 0:
                return True
        published, taken = page.topic_published, page.hop_taken
        for hop, topic in self._hops:
            if taken[hop] != published[topic]:
                if page.hop_waiter[hop] >= 0 and page.hop_follows[hop]:
                    return True
        return False

    def _is_awaited(self, line: Line) -> bool:
        """Return whether a member waits for the frames, or this process does."""
        page, row = self._page, line.row
        return page.line_waiter[row] >= 0 or page.line_pid[row] == page.conductor

    def _call_roll(self) -> None:
        page = self._page
        self._roster = page.roster
        self._top = 1 + max((i for i in range(SLOTS) if page.slot_pid[i]), default=-1)
        rows = [i for i in range(LINES) if page.line_pid[i]]
        known = {line.row: line for line in self._lines}
        self._lines = [known.get(row) or _watched(page, row) for row in rows]
        self._hops = [(i, page.hop_topic[i]) for i in range(HOPS) if page.hop_pid[i]]
        page.top = self._top

    def too_early(self) -> float:
        """Return how long to wait for the wall clock before time may advance [s], 0 = no wait."""
        return max(0.0, self._due_s - time.monotonic()) if self.speed else 0.0

    def move(self, to_ns: int) -> None:
        """Set the time; `release` then wakes the members."""
        page = self._page
        elapsed_s = (to_ns - page.now_ns) * 1e-9
        now_s = self._progress_s = time.monotonic()
        if self.speed:
            self._due_s = max(self._due_s, now_s - _MOST_AHEAD_S) + elapsed_s / self.speed
        page.topic_settled[:] = page.topic_published
        page.now_ns = to_ns
        if now_s - self._factor_s > 1.0:
            page.factor = (to_ns - self._factor_ns) * 1e-9 / (now_s - self._factor_s)
            self._factor_s, self._factor_ns = now_s, to_ns
        for line in self._lines:
            if line.pending() < 0:  # an end has gone, with its count; or frames were not lost
                line.forgive(line.pending())

    def release(self) -> None:
        """Wake every member that waits for this time."""
        page, now_ns = self._page, self._page.now_ns
        until = page.slot_until
        for slot in range(self._top):
            if BUSY < until[slot] <= now_ns:
                until[slot] = BUSY
                page.wake_slot(slot)

    def sleep(self, longest_s: float) -> None:
        """Sleep until a member has changed its state since `look`, for `longest_s` at most."""
        page = self._page
        page.sleep_conductor(self._seen, min(longest_s, _LOOK_S))
        self._check_members()

    def look(self) -> None:
        """Record the changes so far; call it before `quiet`, so that `sleep` misses none."""
        self._seen = self._page.header[4]

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
        holding = {page.slot_pid[slot] for slot in self._busy_slots()}
        holding |= {page.line_pid[line.row] for line in self._unread_lines()}
        holding |= {page.hop_pid[hop] for hop in self._untaken_hops()}
        return any(works(pid) for pid in holding - {0, os.getpid()})

    def _busy_slots(self) -> list[int]:
        page, now_ns = self._page, self._page.now_ns
        return [slot for slot in range(self._top) if page.slot_until[slot] <= now_ns]

    def _unread_lines(self) -> list[Line]:
        return [line for line in self._lines if self._is_awaited(line) and line.pending() > 0]

    def _untaken_hops(self) -> list[int]:
        page = self._page
        return [
            hop
            for hop, topic in self._hops
            if page.hop_taken[hop] != page.topic_published[topic]
            and page.hop_waiter[hop] >= 0
            and page.hop_follows[hop]
        ]

    def _busy_now(self) -> tuple:
        """Return the time and the number of waits of each busy thread; constant while it hangs.

        Waiting threads repeat their declaration now and then; that is no progress.
        """
        page = self._page
        return (page.now_ns, *((slot, page.slot_declared[slot]) for slot in self._busy_slots()))

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
        for slot in self._busy_slots():
            page.slot_until[slot] = FOREVER
            names.append(page.name(slot))
        names += [self._give_up_line(line) for line in self._unread_lines()]
        for hop in self._untaken_hops():
            names.append(f"{page.name(page.hop_waiter[hop])} (a message lost)")
            page.hop_follows[hop] = 0
        if names:
            self.given_up += len(names)
            self._report(
                f"simulated time no longer waits for {', '.join(names)}: no progress for "
                f"{stood_s:.0f} s"
            )

    def _give_up_line(self, line: Line) -> str:
        """Stop waiting for the frames of one line; return the name of its owner."""
        page, waiter = self._page, self._page.line_waiter[line.row]
        if waiter >= 0:
            page.line_waiter[line.row] = NOBODY  # until it waits again
            return f"{page.name(waiter)} (frames not read)"
        line.forgive(line.pending())
        return "the rig (frames lost)"

    def close(self) -> None:
        """Stop the time."""
        with self._page.locked():
            if self._page.conductor == os.getpid():
                self._page.conductor = 0


def _watched(page: Page, row: int) -> Line:
    """Return another member's line, to read its counts."""
    line = Line.__new__(Line)
    line._page, line.row, line._roster, line._peers = page, row, -1, []
    return line
