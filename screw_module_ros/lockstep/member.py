# SPDX-License-Identifier: Apache-2.0
"""A thread that takes part in simulated time: busy, or waiting until a time that it states."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence

from .page import BUSY, FOREVER, NOBODY, Page
from .wires import Hop, Line

_SLICE_S = 0.05
"""Longest sleep of a waiting thread: the cost of a missed wake-up."""


class TimeStandsStill(RuntimeError):
    """Simulated time does not advance; the message names what is missing."""


class Member:
    """One thread of this process.

    name: its name in the conductor's messages. patience_s: wall clock after which a wait without
    progress of time fails [s]; None = wait without limit, until `stopping()` is true.
    """

    def __init__(
        self,
        page: Page,
        name: str,
        stopping: Callable[[], bool],
        patience_s: float | None = None,
    ):
        self._page = page
        self._stopping = stopping
        self._patience_s = patience_s
        with page.locked():
            self.slot = page.take(page.slot_pid, os.getpid(), "thread")
            page.set_name(self.slot, name)
            page.slot_until[self.slot] = BUSY

    def busy(self) -> None:
        """Hold time until the next wait."""
        self._page.slot_until[self.slot] = BUSY

    def idle(self) -> None:
        """Release time for good: this thread no longer uses the clock."""
        if self._page.slot_until[self.slot] != FOREVER:  # a repetition must not count as progress
            self._declare(FOREVER)

    def leave(self) -> None:
        """Return the row: this thread ends."""
        self.idle()
        with self._page.locked():
            self._page.slot_pid[self.slot] = 0
            self._page.changed()

    def wait(
        self, until_ns: int, line: Line | None = None, hops: Sequence[Hop] = ()
    ) -> None:
        """Wait until `until_ns`, or until a frame on `line` or a message on one of `hops` arrives.

        Raises TimeStandsStill.
        """
        page, slot = self._page, self.slot
        if page.now_ns >= until_ns:
            page.slot_until[slot] = BUSY  # an idle or given-up member holds time again from now on
            return
        stood_at, stood_since = page.now_ns, None
        try:
            while True:
                if line is not None:  # each time: the conductor may have reset it
                    page.line_waiter[line.row] = slot
                for hop in hops:
                    page.hop_waiter[hop.row] = slot
                seen = page.slot_wake[slot]
                if page.now_ns >= until_ns or (line is not None and line.pending() > 0):
                    return
                if any(hop.pending() for hop in hops):
                    return
                if page.slot_until[slot] != until_ns:  # a repetition must not count as progress
                    self._declare(until_ns)
                page.sleep_slot(slot, seen, _SLICE_S)
                if page.slot_wake[slot] == seen:
                    if page.now_ns != stood_at:
                        stood_at, stood_since = page.now_ns, None
                    stood_since = self._look_up(stood_since)
        finally:
            page.slot_until[slot] = BUSY
            if line is not None:
                page.line_waiter[line.row] = NOBODY
            for hop in hops:
                page.hop_waiter[hop.row] = NOBODY

    def _declare(self, until_ns: int) -> None:
        page = self._page
        page.slot_declared[self.slot] += 1  # before the time: the conductor looks again
        page.slot_until[self.slot] = until_ns
        if min(page.slot_until[: page.top]) > page.now_ns:
            page.wake_conductor()

    def _look_up(self, since: float | None) -> float:
        """Return since when time has stood still. Raises TimeStandsStill after a while."""
        now = time.monotonic()
        since = now if since is None else since
        page, patience_s = self._page, self._patience_s
        if self._stopping():
            patience_s = 1.0
        if patience_s is not None and now - since > patience_s:
            there = "sim_rig has stopped" if page.conductor else "no sim_rig runs"
            raise TimeStandsStill(
                f"simulated time stands still: {there} (page {page.path.name}); start sim_rig in "
                "this ROS domain and namespace, or set use_sim_time to false"
            )
        return since
