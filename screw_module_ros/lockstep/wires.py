# SPDX-License-Identifier: Apache-2.0
"""Counts frames and messages in transit between members, at both ends of a bus or topic."""

from __future__ import annotations

import os
import threading
import zlib
from contextlib import contextmanager

from .page import HOPS, LINES, TOPICS, Page, alive


class Line:
    """One open bus of this process: counts frames sent, and frames of others handled."""

    def __init__(self, page: Page, bus: str):
        self._page = page
        self._sending = threading.Lock()  # the loop and an SDO transfer send from two threads
        with page.locked():
            row = self.row = page.take(page.line_pid, os.getpid(), "bus")
            page.line_bus[row] = _key(bus)
            page.line_sent[row] = page.line_handled[row] = 0
            page.line_base[row] = sum(page.line_sent[other] for other in self._others())
        self._roster = -1
        self._peers: list[int] = []

    def _others(self) -> list[int]:
        page, key = self._page, self._page.line_bus[self.row]
        return [
            row
            for row in range(LINES)
            if page.line_pid[row] and page.line_bus[row] == key and row != self.row
        ]

    @property
    def peers(self) -> list[int]:
        """Rows of the other ends of this bus."""
        roster = self._page.header[3]
        if self._roster != roster:
            self._roster, self._peers = roster, self._others()
        return self._peers

    def pending(self) -> int:
        """Return the number of frames in transit to this end."""
        page, row = self._page, self.row  # some fifty calls a tick
        sent, missing = page.line_sent, -page.line_base[row] - page.line_handled[row]
        for peer in self.peers:
            missing += sent[peer]
        return missing

    def sent(self) -> None:
        """Count a frame that the bus has accepted, and wake the member that waits for it."""
        page = self._page
        with self._sending:
            page.line_sent[self.row] += 1
        for row in self.peers:
            waiter = page.line_waiter[row]
            if waiter >= 0:
                page.wake_slot(waiter)
            elif page.line_pid[row] == page.conductor:
                page.wake_conductor()

    def handled(self, count: int) -> None:
        """Set the number of other members' frames read since the bus was opened."""
        self._page.line_handled[self.row] = count

    def forgive(self, frames: int) -> None:
        """Count lost `frames` as handled; for the conductor."""
        self._page.line_base[self.row] += frames

    def close(self) -> None:
        """Give the row back."""
        with self._page.locked():
            self._page.line_pid[self.row] = 0
            self._page.changed()


class Source:
    """The publishing end of a topic; `counts` is False if another member already publishes it."""

    def __init__(self, page: Page, topic: str):
        self._page = page
        with page.locked():
            row = self.row = topic_row(page, topic)
            holder = page.topic_pid[row]
            self.counts = holder in (0, os.getpid()) or not alive(holder)
            if self.counts:
                page.topic_pid[row] = os.getpid()
                page.topic_base[row] = page.topic_published[row]
        self._roster = -1
        self._hops: list[int] = []

    def publishing(self) -> None:
        """Count a message; call it just before publishing."""
        if self.counts:
            self._page.topic_published[self.row] += 1

    def published(self) -> None:
        """Wake the members that wait for the message."""
        page = self._page
        if self._roster != page.roster:
            self._roster = page.roster
            self._hops = [h for h in range(HOPS) if page.hop_pid[h] and
                          page.hop_topic[h] == self.row]  # fmt: skip
        for hop in self._hops:
            waiter = page.hop_waiter[hop]
            if waiter >= 0:
                page.wake_slot(waiter)

    def close(self) -> None:
        """Return the topic's row, so that another publisher can be counted."""
        with self._page.locked():
            if self.counts:
                self._page.topic_pid[self.row] = 0


class Hop:
    """The receiving end of a topic: counts the messages that this subscription has taken.

    Time waits for it only while it keeps up: from the first message that was the newest when taken,
    until the conductor gives it up.
    """

    def __init__(self, page: Page, topic: str):
        self._page = page
        with page.locked():
            self._topic = topic_row(page, topic)
            row = self.row = page.take(page.hop_pid, os.getpid(), "subscription")
            page.hop_topic[row] = self._topic
            page.hop_taken[row] = page.hop_follows[row] = 0

    def pending(self) -> bool:
        """Return whether a published message has not been taken."""
        page, row = self._page, self.row
        return bool(page.hop_follows[row]) and (
            page.hop_taken[row] != page.topic_published[self._topic]
        )

    @property
    def is_orphaned(self) -> bool:
        """Whether the topic's publisher has gone, and no other has come."""
        return self._page.topic_pid[self._topic] == 0

    def unsettled(self) -> bool:
        """Return whether a message from before the present time has not been taken."""
        page, row = self._page, self.row
        return bool(page.hop_follows[row]) and (
            page.hop_taken[row] < page.topic_settled[self._topic]
        )

    def is_new(self) -> bool:
        """Return whether the last message taken was published at the present time."""
        return self._page.hop_taken[self.row] > self._page.topic_settled[self._topic]

    def taken(self, number: int) -> None:
        """Record a message taken; number: the middleware's count since the publisher's creation."""
        page, row = self._page, self.row
        published = page.topic_published[self._topic]
        number += page.topic_base[self._topic]
        if not page.hop_taken[row] < number <= published:
            number = published  # from a publisher that is not counted: its number is unknown
        page.hop_taken[row] = number
        if number == published:
            page.hop_follows[row] = 1

    def catch_up(self) -> None:
        """Record that all messages so far have been taken, and follow from now on."""
        page, row = self._page, self.row
        page.hop_taken[row] = page.topic_published[self._topic]
        page.hop_follows[row] = 1

    def hold(self, slot: int) -> None:
        """Follow permanently: time waits for published messages, whether or not `slot` waits."""
        self._page.hop_waiter[self.row] = slot
        self.catch_up()

    @contextmanager
    def paused(self):
        """Do not hold time meanwhile; afterwards as before."""
        page, row = self._page, self.row
        followed = page.hop_follows[row]
        page.hop_follows[row] = 0
        try:
            yield
        finally:
            page.hop_follows[row] |= followed

    def let_go(self) -> None:
        """Stop waiting for this end until it has caught up."""
        self._page.hop_follows[self.row] = 0

    def close(self) -> None:
        """Give the row back."""
        with self._page.locked():
            self._page.hop_follows[self.row] = 0
            self._page.hop_pid[self.row] = 0
            self._page.changed()


def topic_row(page: Page, topic: str) -> int:
    """Return the row of a topic, a new one if needed; the caller holds the lock."""
    key = _key(topic)
    for row in range(TOPICS):
        if page.topic_key[row] == key:
            return row
    return page.take(page.topic_key, key, "topic")


def _key(name: str) -> int:
    raw = name.encode()
    return (zlib.crc32(raw) << 31 | zlib.adler32(raw) & 0x7FFFFFFF) or 1
