# SPDX-License-Identifier: Apache-2.0
"""Counts the missing messages of a topic, from tick numbers and from the middleware's numbers.

There are two counts. `lost`: tick numbers (`sequence`, see `samples.py`) that never arrived,
because the sensor or the publisher skipped them or the transport lost them. `missed`: messages that
were published but did not reach the recorder, from the middleware's number of each message of a
publisher. Lost messages without missed ones are losses on the robot; missed ones are losses of the
recorder.
"""

from __future__ import annotations

import json
from typing import Literal, NamedTuple

from .definitions import fields

NO_SEQUENCE, FLAT, HEADER = 0, 1, 2

_MASK = 0xFFFFFFFF
_RESTART = 100_000  # ticks; a larger step is a restart of the counter, not a gap
_MANY = 256  # different steps; a topic with more has no period
_COMMON = 0.25  # least share of the most frequent step in a topic with a period
_REGULAR = 0.75  # least share of steps that are integer multiples of the most frequent one


class Counts(NamedTuple):
    """Counts of one topic.

    messages: recorded.
    stride: ticks from one message to the next, known or else estimated; 0 without a sequence or
        without a period.
    gaps: number of gaps in the sequence.
    lost: messages missing in the gaps, at that stride; less the duplicates if it is estimated.
    duplicates: messages with the tick number of the previous one.
    out_of_order: messages older than an earlier one.
    restarts: steps too large for a gap (node restarted with another period, clock reset).
    missed: messages published but not received, by the middleware's numbers; -1 if they cannot be
        counted, because several publishers with separate numbers share the topic.
    dropped: messages received but not written (cache full, disk full).
    """

    messages: int = 0
    stride: int = 0
    gaps: int = 0
    lost: int = 0
    duplicates: int = 0
    out_of_order: int = 0
    restarts: int = 0
    missed: int = 0
    dropped: int = 0

    @property
    def complete(self) -> bool:
        """Whether nothing is known to be missing."""
        return not (self.lost or self.missed > 0 or self.dropped or self.out_of_order)

    def as_text(self) -> str:
        """Return the counts as JSON, in the form of the bag."""
        return json.dumps(self._asdict())


def layout(definition: str) -> int:
    """Return the position of `uint32 sequence` in messages of this definition.

    FLAT: directly after a stamp. HEADER: directly after a std_msgs/Header. Else NO_SEQUENCE.
    """
    first = fields(definition)[:2]
    if len(first) < 2 or first[1] != ("uint32", "sequence"):
        return NO_SEQUENCE
    return {"builtin_interfaces/Time": FLAT, "std_msgs/Header": HEADER}.get(first[0][0], 0)


def byte_order(data: bytes) -> Literal["little", "big"]:
    """Return the byte order in a CDR message's encapsulation, "big" for an empty message."""
    return "little" if data[1:2] and data[1] & 1 else "big"


def sequence_of(data: bytes, where: int) -> int:
    """Return the sequence in a CDR message of layout `where`.

    The four bytes of encapsulation come first, then stamp (8), then for HEADER the frame's length
    (4) and text; the number is aligned to 4 from the end of the encapsulation.
    """
    order = byte_order(data)
    start = 12 if where == FLAT else 4 + _after_header(data)
    return int.from_bytes(data[start : start + 4], order)


def _after_header(data: bytes) -> int:
    """Return the offset of the number after a std_msgs/Header [B from the encapsulation's end]."""
    text = int.from_bytes(data[12:16], byte_order(data))
    return 12 + (text + 3 & ~3)


def monotonic_of(data: bytes, where: int) -> int:
    """Return the `int64 monotonic_ns` that follows the sequence in a CDR message [ns].

    It is aligned to 8 bytes in all our message types with a sequence.
    """
    order = byte_order(data)
    start = 20 if where == FLAT else 4 + (_after_header(data) + 4 + 7 & ~7)
    return int.from_bytes(data[start : start + 8], order, signed=True)


class TopicAudit:
    """Counts for one topic, one cheap `update` per message.

    stride: ticks from one message to the next if known, 0 = estimated from the data.
    """

    def __init__(self, where: int, stride: int = 0):
        self.stride = stride
        self._where = where
        self._last = -1
        self._steps: dict[int, int] = {}
        self._number = 0
        self.messages = 0
        self._late = 0
        self._restarts = 0
        self._missed = 0
        self.dropped = 0
        self.single_publisher = True

    def update(self, data: bytes, number: int) -> None:
        """Count one message; number: its publisher's middleware number (0 = none)."""
        self.messages += 1
        if number:
            step = number - self._number
            if step > 1 and self._number:
                self._missed += step - 1
            self._number = number
        if self._where:
            self._tick(sequence_of(data, self._where))

    def _tick(self, sequence: int) -> None:
        last = self._last
        if last < 0:
            self._last = sequence
            return
        step = (sequence - last) & _MASK
        if step < _RESTART:
            self._last = sequence
            steps = self._steps
            if step in steps or len(steps) <= _MANY:
                steps[step] = steps.get(step, 0) + 1
        elif _MASK + 1 - step < _RESTART:
            self._late += 1
        else:
            self._last = sequence
            self._restarts += 1

    def counts(self) -> Counts:
        """Return the counts up to now."""
        forward = {step: n for step, n in self._steps.items() if step}
        stride = (self.stride if forward else 0) or _learned(forward)
        gaps = lost = 0
        duplicates = self._steps.get(0, 0)
        if stride:
            for step, n in forward.items():
                missing = (2 * step + stride) // (2 * stride) - 1
                if missing > 0:
                    gaps += n
                    lost += n * missing
        return Counts(
            messages=self.messages,
            stride=stride,
            gaps=gaps,
            # A late message was first counted as lost. Without a stride of its own a topic may show
            # the newest sample heard: by a little jitter one comes twice, and the next is skipped.
            lost=max(0, lost - self._late - (0 if self.stride else duplicates)),
            duplicates=duplicates,
            out_of_order=self._late,
            restarts=self._restarts,
            missed=self._missed if self.single_publisher else -1,
            dropped=self.dropped,
        )


def _learned(steps: dict[int, int]) -> int:
    """Return the most frequent step if most others are integer multiples of it, else 0."""
    if not steps or len(steps) > _MANY:
        return 0
    stride = max(steps, key=lambda step: (steps[step], -step))
    total = sum(steps.values())
    whole = sum(n for step, n in steps.items() if step % stride == 0)
    return stride if steps[stride] >= _COMMON * total and whole >= _REGULAR * total else 0
