# SPDX-License-Identifier: Apache-2.0
"""Counts the missing messages of a topic, from tick numbers and from the middleware's numbers.

`lost`: tick numbers (`sequence`, see `samples.py`) that never arrived, because the sensor or the
publisher skipped them or the transport lost them. `missed`: messages that were published but did
not reach the recorder, by the middleware's number of each message of a publisher. Lost messages
without missed ones are losses on the robot; missed ones are losses of the recorder.

A topic has ticks if its messages begin with stamp or header, `uint32 sequence` and `int64
monotonic_ns`. Its stride, the ticks from one message to the next, is known from the table of the
graph: one that is estimated from the messages would hide a regular loss.
"""

from __future__ import annotations

import json
import struct
from collections import deque
from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

from ..graph import ENCODER_DECIMATED, TOPICS
from .bag import Topic
from .definitions import fields

TICKED = {topic.type: topic for topic in TOPICS.values() if topic.clock}
"""Topics of the graph whose messages follow ticks, by type, as names can be remapped."""
_DECIMATED = "/" + ENCODER_DECIMATED.rpartition("/")[2]  # topic of the same type at another rate
_TICKS = [("uint32", "sequence"), ("int64", "monotonic_ns")]
_HEADER = "std_msgs/Header"
_MASK = 0xFFFFFFFF
_RESTART = 100_000  # ticks; a larger step is a restart of the counter, not a gap
_MANY = 256  # different steps that are kept apart
_SHOWN = 5  # gaps listed per topic


class Counts(NamedTuple):
    """Counts of one topic.

    messages: recorded. stride: ticks from one message to the next, 0 if unknown or without ticks.
    gaps: in the ticks. lost: messages missing in the gaps. duplicates: messages with the tick of
    the previous one. out_of_order: messages with an older tick than an earlier one of their
    publisher, by its message numbers where it has them; their order in the file does not count, as
    a recorder may have sorted by a clock that was set. restarts: steps too large
    for a gap (node restarted, clock reset). missed: messages published but not received, -1 if that
    cannot be counted. dropped: messages received but not written (cache full, disk full).
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


class Gap(NamedTuple):
    """A gap in the ticks: log time of the message before it [ns], number of missing ones."""

    log_time: int
    missing: int


class Count:
    """Counts one topic. dropped, several: set by the owner; several: publishers share the topic."""

    def __init__(self, topic: Topic):
        self.topic = topic
        self.messages = self.dropped = 0
        self.numbered = self.several = False
        first, *rest = fields(topic.definition.text)[:3] or [("", "")]
        self._stamp = first[0] if rest == _TICKS else ""
        self._steps: dict[int, int] = {}
        self._places: list[tuple[int, int]] = []  # log time before a step, and the step
        self._last = self._number = self._time = 0
        self._missed = self._late = self._moved = self._restarts = 0
        self._absent: deque[tuple[int, int]] = deque(maxlen=_MANY)  # first and last missing number

    def take(self, number: int, data: bytes, log_time: int = 0) -> None:
        """Count a message; number: its publisher's, 0 without. log_time: of its gaps [ns]."""
        is_moved = bool(number) and self._numbered(number)
        if self._stamp:
            self._tick(tick_of(data, self.after_header), is_moved)
        self.messages += 1
        self._time = log_time

    def _numbered(self, number: int) -> bool:
        """Count a publisher's number; return whether it is one that was missing up to now."""
        self.numbered = True
        for place, (first, last) in enumerate(self._absent if number < self._number else ()):
            if first <= number <= last:
                self._missed -= 1
                del self._absent[place]
                parts = ((first, number - 1), (number + 1, last))
                self._absent.extend(part for part in parts if part[0] <= part[1])
                return True
        if 0 < self._number < number - 1:
            self._missed += number - self._number - 1
            self._absent.append((self._number + 1, number - 1))
        self._number = number
        return False

    def _tick(self, tick: int, is_moved: bool) -> None:
        step = (tick - self._last) & _MASK
        if self.messages and _MASK + 1 - step < _RESTART:
            self._moved += is_moved
            self._late += not is_moved
            return
        self._last = tick
        if not self.messages:
            return
        if step >= _RESTART:
            self._restarts += 1
        elif step in self._steps or len(self._steps) < _MANY:
            seen = self._steps.get(step, 0)
            self._steps[step] = seen + 1
            if seen < _SHOWN:
                self._places.append((self._time, step))

    @property
    def after_header(self) -> bool:
        """Whether a header, and not a stamp alone, comes before its ticks."""
        return self._stamp == _HEADER

    @property
    def ticked(self) -> bool:
        """Whether its messages follow ticks of the graph."""
        return bool(self._stamp) and self.topic.type in TICKED

    def stride(self, parameters: Mapping[str, str]) -> int:
        """Return the ticks from one message to the next, 0 if unknown or without ticks.

        parameters: by node, as JSON; the stride of some topics is a parameter.
        """
        if not self.ticked or self.topic.name.endswith(_DECIMATED):
            return 0
        ticked = TICKED[self.topic.type]
        if isinstance(ticked.every, int):
            return ticked.every
        every = parameter(parameters, ticked.clock, ticked.every)
        return every if isinstance(every, int) and every > 0 else 0

    def result(self, parameters: Mapping[str, str]) -> Counts:
        """Return the counts up to now; parameters: see `stride`."""
        stride = self.stride(parameters)
        missing = {step: n for step, n in self._steps.items() if _missing(step, stride)}
        lost = sum(n * _missing(step, stride) for step, n in missing.items())
        return Counts(
            messages=self.messages,
            stride=stride,
            gaps=sum(missing.values()),
            lost=max(0, lost - self._late - self._moved),  # a late one was first counted as lost
            duplicates=self._steps.get(0, 0),
            out_of_order=self._late,
            restarts=self._restarts,
            missed=-1 if self.several else self._missed,
            dropped=self.dropped,
        )

    def gaps(self, parameters: Mapping[str, str]) -> list[Gap]:
        """Return the first gaps."""
        stride = self.stride(parameters)
        found = [Gap(time, _missing(step, stride)) for time, step in self._places]
        return [gap for gap in found if gap.missing][:_SHOWN]


def parameter(parameters: Mapping[str, str], node: str, name: str) -> Any:
    """Return a parameter of the node of this name in any namespace, None if it is unknown."""
    for full, text in parameters.items():
        if full.rpartition("/")[2] == node:
            try:
                return json.loads(text)[name]
            except (ValueError, TypeError, KeyError):  # it did not answer, or the text is damaged
                return None
    return None


def tick_of(data: bytes, after_header: bool) -> int:
    """Return the tick number in a CDR message, after a stamp or a std_msgs/Header."""
    order, start = _tick_at(data, after_header)
    return int.from_bytes(data[start : start + 4], order)


def times_of(data: bytes, after_header: bool) -> tuple[int, int]:
    """Return stamp and monotonic time of a message with ticks [ns]; zeros if it is too short."""
    order, start = _tick_at(data, after_header)
    at = 4 + (start + 7 & ~7)  # aligned to 8 from the end of the encapsulation
    if len(data) < at + 8:
        return 0, 0
    mark = "<" if order == "little" else ">"
    seconds, nanoseconds = struct.unpack_from(f"{mark}iI", data, 4)
    return seconds * 1_000_000_000 + nanoseconds, *struct.unpack_from(f"{mark}q", data, at)


def _tick_at(data: bytes, after_header: bool) -> tuple[Literal["little", "big"], int]:
    """Return byte order and place of the tick number in a CDR message.

    Four bytes of encapsulation come first, then the stamp (8), then for a header the frame's length
    (4) and text; the number is aligned to 4 from the end of the encapsulation.
    """
    order: Literal["little", "big"] = "little" if data[1:2] and data[1] & 1 else "big"
    text = int.from_bytes(data[12:16], order) if after_header else 0
    return order, 16 + (text + 3 & ~3) if after_header else 12


def _missing(step: int, stride: int) -> int:
    """Return the messages missing in a step of ticks; jitter round the stride is no loss."""
    return max(0, (2 * step + stride) // (2 * stride) - 1) if stride else 0
