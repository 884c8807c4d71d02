# SPDX-License-Identifier: Apache-2.0
"""One counter for frames, messages and requests in transit: the ends of a channel."""

from __future__ import annotations

import threading
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from .page import NOBODY, ROSTER, Page, alive


class End:
    """This process's end of a channel: a bus, a topic, the requests to a node, or its answers.

    It counts what it sent, and what it has taken of the others'. Time waits for what is in transit
    to an end at which a thread waits, while the end keeps up: from the first time that it has taken
    everything, until the conductor gives it up.

    channel: the same name at all ends. sends: whether it may send. numbered: a message carries its
    sender's number, so that only the first sender of the channel counts. follows: it keeps up from
    the start. page: of the time.
    """

    def __init__(
        self,
        page: Page,
        channel: str,
        sends: bool = False,
        numbered: bool = False,
        follows: bool = False,
    ):
        self.page = page
        self._counting = threading.Lock()
        self._roster = -1
        self._senders: list[int] = []
        self._others: list[int] = []
        raw = channel.encode()
        key = zlib.crc32(raw) << 31 | zlib.adler32(raw) & 0x7FFFFFFF
        with page.locked():
            for pid in {page.end_pid[row] for row in page.ends_of(key)}:
                if not alive(pid):
                    page.dismiss(pid)
            row = self.row = page.take(page.end_pid, "bus, topic or service")
            page.channel[row], page.waiter[row] = key, NOBODY
            page.sent[row] = page.settled[row] = 0
            page.sends[row] = sends and not (numbered and page.senders_to(row))
            page.follows[row] = follows
            page.taken[row] = self._total(page.sent)

    # Sending -------------------------------------------------------------------------------

    def count(self) -> None:
        """Count one that is sent: a message just before, a frame when the bus has accepted it."""
        with self._counting:  # the loop and an SDO transfer send from two threads
            self.page.sent[self.row] += self.page.sends[self.row]

    def announce(self) -> None:
        """Wake the threads that wait for what was sent."""
        page = self.page
        self._look_up()
        for row in self._others:
            waiter = page.waiter[row]
            if waiter >= 0:
                page.wake_thread(waiter)
            elif page.end_pid[row] == page.conductor:
                page.wake_conductor()

    def counted(self, send: Callable[[Any], object]) -> Callable[[Any], None]:
        """Return `send`, which counts each message just before and wakes who waits for it after.

        It is `count` and `announce` in one call: there are thousands of messages a second.
        """
        page, row, header = self.page, self.row, self.page.header
        sent, sends, counting, waiter = page.sent, page.sends, self._counting, page.waiter

        def send_counted(message: Any) -> None:
            with counting:
                sent[row] += sends[row]
            send(message)
            if self._roster != header[ROSTER]:
                self._look_up()
            for other in self._others:
                if waiter[other] >= 0:
                    page.wake_thread(waiter[other])

        return send_counted

    # Taking --------------------------------------------------------------------------------

    @property
    def follows(self) -> bool:
        """Whether it keeps up: time waits for it."""
        return bool(self.page.follows[self.row])

    @property
    def pending(self) -> bool:
        """Whether something was sent and has not been taken."""
        page, row = self.page, self.row
        return bool(page.follows[row]) and page.taken[row] < self._total(page.sent)

    @property
    def unsettled(self) -> bool:
        """Whether something was sent before the present time and has not been taken."""
        page, row = self.page, self.row
        return bool(page.follows[row]) and page.taken[row] < self._total(page.settled)

    @property
    def is_early(self) -> bool:
        """Whether the one taken last was sent at the present time."""
        return self.page.taken[self.row] > self._total(self.page.settled)

    @property
    def is_orphaned(self) -> bool:
        """Whether nobody sends here any more."""
        self._look_up()
        return not self._senders

    def take(self, number: int) -> None:
        """Record that this one has been taken, and all before it; numbers begin with 1.

        One that cannot be is of a sender that is not counted.
        """
        total = self._total(self.page.sent)
        self._take(number if self.page.taken[self.row] < number <= total else total, total)

    def take_next(self) -> None:
        """Record that one more has been taken; its sender may count it only now."""
        self._take(self.page.taken[self.row] + 1, self._total(self.page.sent))

    def catch_up(self) -> None:
        """Record that everything so far has been taken, and follow from now on."""
        total = self._total(self.page.sent)
        self._take(total, total)

    def _take(self, number: int, total: int) -> None:
        page, row = self.page, self.row
        page.taken[row] = number
        if number >= total:
            page.follows[row] = 1

    def hold(self, thread: int) -> None:
        """Follow permanently: time waits whether or not the thread in this row waits."""
        self.page.waiter[self.row] = thread
        self.catch_up()

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Do not hold time meanwhile; afterwards as before."""
        page, row = self.page, self.row
        followed = page.follows[row]
        page.follows[row] = 0
        try:
            yield
        finally:
            page.follows[row] |= followed

    def stop_following(self) -> None:
        """Stop waiting for this end until it has caught up."""
        self.page.follows[self.row] = 0

    def close(self) -> None:
        """Return the row."""
        with self.page.locked():
            self.page.leave(self.row)

    def _total(self, words: memoryview) -> int:
        """Return the sum over the other ends; some fifty calls a tick."""
        if self._roster != self.page.header[ROSTER]:
            self._look_up()
        total = 0
        for row in self._senders:
            total += words[row]
        return total

    def _look_up(self) -> None:
        page, roster = self.page, self.page.header[ROSTER]
        if self._roster != roster:
            self._others = [row for row in page.ends_of(page.channel[self.row]) if row != self.row]
            self._senders = [row for row in self._others if page.sends[row]]
            self._roster = roster
