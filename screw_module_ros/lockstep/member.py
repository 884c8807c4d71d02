# SPDX-License-Identifier: Apache-2.0
"""A thread that takes part in simulated time: busy, or waiting until a time that it states."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Protocol

from ..clock import TimeStandsStill
from .page import BUSY, FOREVER, NOBODY, NOW, THREADS, TOP, Page

_SLICE_S = 0.05
"""Longest sleep of a waiting thread: the cost of a missed wake-up."""


class Awaited(Protocol):
    """The end of a channel at which a thread waits (`End`). row: of it in the page."""

    row: int

    @property
    def pending(self) -> bool:
        """Whether something was sent and has not been taken."""


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
            self.row = page.take(page.thread_pid, "thread")
            page.set_name(self.row, name)
            page.until[self.row] = BUSY

    def busy(self) -> None:
        """Hold time until the next wait."""
        self._page.until[self.row] = BUSY

    def idle(self) -> None:
        """Release time for good: this thread no longer uses the clock."""
        if self._page.until[self.row] != FOREVER:  # a repetition must not count as progress
            self._declare(FOREVER)

    def leave(self) -> None:
        """Return the row: this thread ends."""
        self.idle()
        with self._page.locked():
            self._page.thread_pid[self.row] = 0
            self._page.changed()

    def wait(self, until_ns: int, ends: Sequence[Awaited] = ()) -> None:
        """Wait until `until_ns`, or until something is in transit to one of `ends`.

        Raises TimeStandsStill.
        """
        page, row, header = self._page, self.row, self._page.header
        if header[NOW] >= until_ns:
            page.until[row] = BUSY  # an idle or given-up member holds time again from now on
            return
        stood_at, stood_since = header[NOW], None
        try:
            while True:
                for end in ends:  # each time: the conductor may have reset it
                    page.waiter[end.row] = row
                seen = page.wake[row]
                if header[NOW] >= until_ns:
                    return
                for end in ends:
                    if end.pending:
                        return
                if page.until[row] != until_ns:  # a repetition must not count as progress
                    self._declare(until_ns)
                page.sleep_thread(row, seen, _SLICE_S)
                if page.wake[row] == seen:
                    if header[NOW] != stood_at:
                        stood_at, stood_since = header[NOW], None
                    stood_since = self._look_up(stood_since)
        finally:
            page.until[row] = BUSY
            for end in ends:
                page.waiter[end.row] = NOBODY

    def _declare(self, until_ns: int) -> None:
        page = self._page
        header, until = page.header, page.until
        page.waits[self.row] += 1  # before the time: the conductor looks again
        until[self.row] = until_ns
        if min(until[: header[TOP] or THREADS]) > header[NOW]:
            page.wake_conductor()

    def _look_up(self, since: float | None) -> float:
        """Return since when time has stood still. Raises TimeStandsStill after a while."""
        now = time.monotonic()
        since = now if since is None else since
        page, patience_s = self._page, self._patience_s
        if self._stopping():
            patience_s = 1.0
        if patience_s is not None and now - since > patience_s:
            there = "sim_rig has stopped" if page.conductor else "no sim_rig runs on this machine"
            raise TimeStandsStill(
                f"simulated time stands still: {there} (page {page.path.name}); start sim_rig in "
                "this ROS domain and namespace, or set use_sim_time to false"
            )
        return since
