# SPDX-License-Identifier: Apache-2.0
"""One request a tick, one answer to it: the bookkeeping of the encoder and of the force sensor."""

from __future__ import annotations

from typing import Generic, Protocol, TypeVar

from ..can_io.port import Port
from .request_tracker import FRESH, LATE, RequestTracker

Sample = TypeVar("Sample")


class PollCounters(Protocol):
    """The counters that `Polled` keeps up to date; the devices have more."""

    requests: int
    received: int
    missing: int
    missing_in_a_row: int
    late: int
    unexpected: int
    silent: int


class Polled(Generic[Sample]):
    """Ticks, requests and answers of one device; a tick that delivers no sample is missing.

    counters: of the device. parts: frames of one answer. asked: sequence and both clocks [ns] of
    the newest tick.
    """

    __slots__ = ("_counters", "_fresh", "_port", "_tracker", "_waiting", "asked")

    def __init__(self, port: Port, counters: PollCounters, parts: int = 1):
        self._port = port
        self._counters = counters
        self._tracker = RequestTracker(parts)
        self.asked = (0, 0, 0)
        self._waiting = False
        self._fresh: Sample | None = None

    def restart(self) -> None:
        """Forget what was asked for: for a start, when nothing can be under way."""
        self._tracker.reset()
        self._waiting = False
        self._fresh = None

    def begin(self, sequence: int, monotonic_ns: int, stamp_ns: int) -> bool:
        """Begin a tick by draining the bus; return whether a request may be sent.

        Frames that came after the end of their tick do not count for this one, not even after an
        answer: each later frame would otherwise be taken for the next sample, one period too old.
        Raises BusError when the bus cannot be read; the tick counts all the same.
        """
        self._tick(sequence, monotonic_ns, stamp_ns)
        self._tracker.end_tick()
        self._port.pump()
        return self._ask()

    def begin_unasked(self, sequence: int, monotonic_ns: int, stamp_ns: int) -> None:
        """Begin a tick in which another master asks the device."""
        self._tick(sequence, monotonic_ns, stamp_ns)
        self._ask()

    def note(self, part: int = 0) -> int:
        """Note one frame of an answer; return the verdict on it."""
        return self._tracker.answer(part)

    def is_fresh(self, verdict: int) -> bool:
        """Return whether a frame with this verdict is to be used; count it when it is not."""
        if verdict == FRESH:
            return True
        if verdict == LATE:
            self._counters.late += 1
        else:
            self._counters.unexpected += 1
        return False

    def deliver(self, sample: Sample) -> None:
        """Take the sample that answers this tick."""
        self._waiting = False
        self._counters.received += 1
        self._counters.missing_in_a_row = 0
        self._fresh = sample

    def take(self) -> Sample | None:
        """Return the sample of this tick, once; None while there is none."""
        sample, self._fresh = self._fresh, None
        return sample

    def _tick(self, sequence: int, monotonic_ns: int, stamp_ns: int) -> None:
        counters = self._counters
        counters.requests += 1
        if self._waiting:
            counters.missing += 1
            counters.missing_in_a_row += 1
        self.asked = (sequence, monotonic_ns, stamp_ns)
        self._fresh = None
        self._waiting = True

    def _ask(self) -> bool:
        asked = self._tracker.ask()
        if not asked:
            self._counters.silent += 1
        return asked
