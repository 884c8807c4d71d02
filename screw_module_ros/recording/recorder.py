# SPDX-License-Identifier: Apache-2.0
"""A running recording: a writing thread writes the messages of a receiving thread.

The receiving thread only appends to a queue; counts, chunks, compression and disk belong to the
writing thread, which releases the GIL during compression and disk access. Errors never reach the
receiving thread: an error ends the recording and appears in `status`; later messages count as
dropped.
"""

from __future__ import annotations

import hashlib
import shutil
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from operator import itemgetter
from pathlib import Path
from typing import NamedTuple

from ..clock import Clock, WallClock
from .bag import Bag, BagError, BagFullError, Message, StorageSettings, Topic
from .counts import Count, Counts
from .timeline import Timeline

AUDIT, PARAMETERS, REFUSED, CLOCK = "audit", "parameters", "not recorded", "clock"
"""Notes in a bag: counts by topic, parameters by node, reasons by topic that is not recorded, local
time of the beginning and when the system clock was set."""
NO_ANSWER = "no answer"
"""In place of the parameters of a node that did not answer."""
_OVERHEAD = 300  # B of memory of a waiting message beyond its data
_PASS_S = 0.1


class Status(NamedTuple):
    """Status of a recording.

    error: why it ended by itself, empty without an error. messages: on the disk; waiting: received,
    not yet written; dropped: received, but not in the bag. size: of the current file [B]. audit:
    counts per topic. held: why nothing reaches the disk at present, empty if it does.
    """

    error: str
    messages: int
    waiting: int
    dropped: int
    size: int
    audit: dict[str, Counts]
    held: str = ""

    @property
    def records(self) -> bool:
        """Whether messages reach the disk."""
        return not (self.error or self.held)

    def summary(self) -> str:
        """Return it in one sentence, an error first."""
        lost = sum(counts.lost for counts in self.audit.values())
        missed = sum(max(0, counts.missed) for counts in self.audit.values())
        text = (
            f"{self.messages} messages of {len(self.audit)} topics, "
            f"{lost} ticks lost, {missed} not received, {self.dropped} not written"
        )
        why = self.error or self.held
        return f"{why}; {text}" if why else text


class Recording:
    """Writes a bag in a thread, from `start` until `close`."""

    def __init__(
        self,
        bag: Bag,
        settings: StorageSettings | None = None,
        free_space: Callable[[], int] | None = None,
        clock: Clock | None = None,
    ):
        """Own `bag` from now on; free_space: returns the free space of the disk [B].

        clock: whose stamps are the log times, by default the system's.
        """
        self.folder = bag.folder
        self._bag = bag
        self._settings = settings or StorageSettings()
        self._free_space = free_space or (lambda: shutil.disk_usage(self.folder).free)
        self._queue: deque[list[Message]] = deque()
        # Only one thread writes each counter, so none needs the lock.
        self._received = self._received_bytes = 0
        self._taken = self._taken_bytes = 0
        self._refused: Counter[int] = Counter()
        self._unsafe: Counter[int] = Counter()  # since the last flush
        self._unwritten: Counter[int] = Counter()
        self._lock = threading.Lock()
        self._counts: list[Count] = []  # by channel, from 1
        self._notes: dict[str, dict[str, str]] = {}
        self._due: list[str] = []  # notes to be written
        self._error = self._held = ""
        self._timeline = Timeline(clock or WallClock())
        self._flushed_ns: int | None = None
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Start the writing thread."""
        self._thread = threading.Thread(target=self._run, name="bag writer", daemon=True)
        self._thread.start()

    def add_topic(self, topic: Topic) -> int:
        """Add a topic; return its channel. From any thread."""
        with self._lock:
            self._counts.append(Count(topic))
            return len(self._counts)

    def note(self, name: str, values: dict[str, str]) -> None:
        """Store `values` in the bag under `name` if they are new. From any thread."""
        with self._lock:
            if self._notes.get(name) != values:
                self._notes[name] = dict(values)
                self._due.append(name)

    def several_publishers(self, channel: int) -> None:
        """Note that a topic has several publishers. From any thread."""
        self._counts[channel - 1].several = True

    def put(self, messages: Sequence[Message]) -> None:
        """Append messages to the queue. From one receiving thread; never blocks or raises."""
        messages = self._timeline.continued(messages)
        size = _size(messages)
        waiting = self._received_bytes - self._taken_bytes
        if self._error or waiting + size > self._settings.max_cache:
            self._refused.update(message[0] for message in messages)
            return
        self._received_bytes += size
        self._received += len(messages)
        self._queue.append(list(messages))

    def work(self, now_ns: int) -> None:
        """One pass of the writing thread at `now_ns` (CLOCK_MONOTONIC): write, flush when due."""
        with self._lock:
            if self._error:
                self._take()
                self._drop()
                return
            try:
                if self._held and not self._has_room():
                    return
                self._write(self._take())
                self._flushed_ns = now_ns if self._flushed_ns is None else self._flushed_ns
                if now_ns - self._flushed_ns >= self._settings.flush_period * 1e9:
                    self._flushed_ns = now_ns
                    self._flush()
            except BagFullError as error:
                self._held = str(error)
                if self._bag.message_count == self._bag.written:  # an index alone had no room
                    self._unsafe.clear()
            except BagError as error:
                self._fail(str(error))

    def _has_room(self) -> bool:
        """Return whether writing can go on. Raises BagFullError, BagError."""
        if self._bag.rests:
            if self._free_space() < 2 * self._settings.min_free_space:
                return False
            self._bag.go_on()
        self._bag.flush()
        self._unsafe.clear()
        if self._bag.rests:  # its index has found room now
            return self._has_room()
        self._held = ""
        return True

    def _take(self) -> list[Message]:
        batch: list[Message] = []
        while self._queue:
            messages = self._queue.popleft()
            self._taken_bytes += _size(messages)
            self._taken += len(messages)
            batch += messages
        self._unsafe.update(message[0] for message in batch)
        return _in_time(batch)

    def _write(self, batch: Sequence[Message]) -> None:
        for count in self._counts[len(self._bag.topics) :]:
            self._bag.add_topic(count.topic)
        for message in batch:
            self._counts[message[0] - 1].take(message[3], message[4])
        self._bag.write(batch)

    def _flush(self) -> None:
        self._write_notes()
        self._bag.flush()
        self._unsafe.clear()
        free, least = self._free_space(), self._settings.min_free_space
        if free < least:
            self._write_audit()
            self._bag.rest()
            self._unsafe.clear()
            self._held = (
                f"only {free / 2**20:.0f} MiB left on the disk: the bag was closed, and goes on "
                f"with {2 * least / 2**20:.0f} MiB; free disk space or choose another folder"
            )

    def _write_notes(self) -> None:
        if (told := self._timeline.note()) != self._notes.get(CLOCK):
            self._notes[CLOCK] = told
            self._due.append(CLOCK)
        for name in self._due:
            self._bag.note(name, self._notes[name])
        self._due.clear()

    def _write_audit(self) -> None:
        """Write the last notes and counts."""
        self._write_notes()
        self._bag.note(AUDIT, {name: counts.as_text() for name, counts in self._audit().items()})

    def _end(self) -> None:
        """Close the bag, with the last counts in it; what waits for room on the disk is lost."""
        if self._held:
            self._bag.cut_back()
            self._fail(self._held)
            return
        self._write_audit()
        self._bag.close()
        self._unsafe.clear()

    def _fail(self, error: str) -> None:
        self._error = self._error or error
        self._drop()

    def _drop(self) -> None:
        """Count what came after the last flush as not written."""
        self._unwritten += self._unsafe
        self._unsafe.clear()

    @property
    def _dropped(self) -> int:
        return self._refused.total() + self._unwritten.total()

    def _audit(self) -> dict[str, Counts]:
        for channel, number in (Counter(self._refused) + self._unwritten).items():
            self._counts[channel - 1].dropped = number
        parameters = self._notes.get(PARAMETERS, {})
        return {count.topic.name: count.result(parameters) for count in self._counts}

    def status(self) -> Status:
        """Return the present status. From any thread."""
        with self._lock:
            return Status(
                error=self._error,
                messages=self._bag.message_count,
                waiting=self._received - self._taken,
                dropped=self._dropped,
                size=self._bag.size,
                audit=self._audit(),
                held=self._held,
            )

    def close(self) -> Status:
        """Write the waiting messages, close the bag, and return the last status."""
        self._stopping.set()
        if self._thread is not None:
            self._thread.join()
        if not self._bag.rests:
            self.work(time.monotonic_ns())
        with self._lock:
            if not self._error:
                try:
                    self._end()
                except BagError as error:
                    self._fail(str(error))
            self._held = ""
            if self._error:
                self._take()
                self._drop()
                if self._bag.rests and self._dropped:
                    self._bag.end_early(self._dropped)
        return self.status()

    def _run(self) -> None:
        while not self._stopping.wait(_PASS_S):
            try:
                self.work(time.monotonic_ns())
            except Exception as error:  # report a defect instead of ending the thread silently
                self._fail(f"the recording failed: {type(error).__name__}: {error}")


def _in_time(batch: list[Message]) -> list[Message]:
    """Return messages in order of time, those of one topic in the order in which they came.

    They come topic by topic; a player searches less in order of time. Where log times of a topic
    fall, as of a clock that was set back, the largest one before counts.
    """
    latest: dict[int, int] = {}
    due = []
    for message in batch:
        channel, time_ns = message[:2]
        latest[channel] = max(time_ns, latest.get(channel, time_ns))
        due.append((latest[channel], message))
    due.sort(key=itemgetter(0))
    return [message for _, message in due]


def _size(messages: Sequence[Message]) -> int:
    """Return the memory of messages [B]."""
    return sum(len(message[4]) for message in messages) + _OVERHEAD * len(messages)


def file_hashes(names: Sequence[str]) -> dict[str, str]:
    """Return the SHA-256 of each file, or "unreadable" with the reason."""
    found = {}
    for name in filter(None, names):
        try:
            content = Path(name).expanduser().read_bytes()
            found[name] = f"sha256:{hashlib.sha256(content).hexdigest()}"
        except OSError as error:
            found[name] = f"unreadable: {error.strerror}"
        except (RuntimeError, ValueError) as error:  # for instance an unknown home folder
            found[name] = f"unreadable: {error}"
    return found
