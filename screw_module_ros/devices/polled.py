# SPDX-License-Identifier: Apache-2.0
"""One request and one answer per tick: the bookkeeping of encoder and force sensor."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

from ..clock import Clock
from .surplus import Surplus

Sample = TypeVar("Sample")
#: Verdicts on a frame; all but FRESH are also names of counters.
FRESH, LATE, UNEXPECTED, WRONG_LENGTH = "fresh", "late", "unexpected", "wrong_length"


class Line(Protocol):
    """What a device is reached by: a CAN bus (`can_io.port.Port`), or something else.

    name: for messages. counters: for the diagnostics. failed: it takes nothing any more until
    `restore`; bus_off: of a CAN bus.
    """

    name: str
    clock: Clock
    counters: Counter[str]
    failed: bool
    bus_off: bool

    def pump(self, until_ns: int = 0) -> int:
        """Wait at most until `until_ns` [ns] for an answer, then process all that wait.

        Returns their number; 0 = no wait. Raises BusError.
        """

    def restore(self) -> None:
        """Open it anew if it has failed. Raises BusError."""

    def close(self) -> None:
        """Close it."""


class RequestTracker:
    """Matches answers to requests when frames carry no number (TPDOs, ATI sensor).

    A device answers in order, so the number of open requests separates a late answer from a new
    one: only the answer that closes the last open request is new. When a tick ends with one answer
    received and one request still open, either an answer was lost or all answers are late. Then no
    request is sent until a tick passes without an answer; answers that have not arrived by then
    count as lost. So an old value never passes for a new one.

    parts: number of frames that make one answer, in this order.
    """

    __slots__ = ("_arrived", "_open", "_over", "listening")

    def __init__(self, parts: int = 1):
        self._open = [0] * parts
        self.reset()

    def reset(self) -> None:
        """Close all requests; call it at a start, when no answer can be in transit."""
        self._open = [0] * len(self._open)
        self._arrived = 0
        self._over = self.listening = False

    def end_tick(self) -> None:
        """End the tick: an answer that arrives before the next `ask` is late."""
        self._over = True

    def ask(self) -> bool:
        """Begin a tick; return whether a request may be sent in it (if not, only listen)."""
        open_requests = any(self._open)
        if self.listening:
            if not open_requests or not self._arrived:
                self._open = [0] * len(self._open)
                self.listening = False
        elif open_requests and self._arrived:
            self.listening = True
        self._arrived = 0
        self._over = False
        if not self.listening:
            for part in range(len(self._open)):
                self._open[part] += 1
        return not self.listening

    def answer(self, part: int = 0) -> str:
        """Process one frame; return FRESH when it belongs to the newest request."""
        self._arrived += 1
        open_requests = self._open
        if not open_requests[part]:
            return UNEXPECTED
        open_requests[part] -= 1
        for earlier in range(part):
            # Frames of one answer come in order: a missing earlier one was lost.
            open_requests[earlier] = min(open_requests[earlier], open_requests[part])
        return LATE if open_requests[part] or self.listening or self._over else FRESH


class Polled(Generic[Sample]):
    """Ticks, requests and answers of one device; a tick that delivers no sample is missing.

    counters: of the device; those updated here are requests (ticks), received (samples delivered),
    missing (ticks without one), missing_in_a_row (up to now), late (frames that came after the next
    request), unexpected (frames without a request), wrong_length (frames dropped) and silent (ticks
    without a request, to distinguish late from lost). parts: frames of one answer. doubled():
    called when the unexpected ones are so many that another device answers too. asked: sequence and
    both clocks [ns] of the newest tick.
    """

    __slots__ = (
        "_counters", "_doubled", "_fresh", "_port", "_surplus", "_tracker", "_waiting", "asked",
    )  # fmt: skip

    def __init__(
        self, port: Line, counters: Counter[str], doubled: Callable[[], object], parts: int = 1
    ):
        self._port = port
        self._counters = counters
        self._doubled = doubled
        self._surplus = Surplus()
        self._tracker = RequestTracker(parts)
        self.asked = (0, 0, 0)
        self.restart()

    def restart(self) -> None:
        """Drop all open requests; call it at a start, when no answer can be in transit."""
        self._tracker.reset()
        self._surplus.restart(self._counters["received"], self._counters["missing"])
        self._waiting = False
        self._fresh: Sample | None = None

    def begin(self, sequence: int, monotonic_ns: int, stamp_ns: int) -> bool:
        """Begin a tick: read all waiting frames; return whether a request may be sent.

        Frames that came after the end of their tick do not count for this one. Otherwise each later
        frame would pass for the next sample and be one period too old. Raises BusError when the bus
        cannot be read; the tick still counts.
        """
        self._tick(sequence, monotonic_ns, stamp_ns)
        self._tracker.end_tick()
        self._port.pump()
        return self._ask()

    def begin_unasked(self, sequence: int, monotonic_ns: int, stamp_ns: int) -> None:
        """Begin a tick in which another master sends the request."""
        self._tick(sequence, monotonic_ns, stamp_ns)
        self._ask()

    def note(self, well_formed: bool, part: int = 0) -> str:
        """Process one frame of an answer; only a FRESH one may be used, others are counted."""
        verdict = self._tracker.answer(part)
        if not well_formed:
            verdict = WRONG_LENGTH
        if verdict != FRESH:
            counters = self._counters
            counters[verdict] += 1
            if verdict == UNEXPECTED and self._surplus.note(
                counters["received"], counters["missing"]
            ):
                self._doubled()
        return verdict

    def deliver(self, sample: Sample) -> None:
        """Store the sample that answers this tick."""
        self._waiting = False
        self._counters["received"] += 1
        self._counters["missing_in_a_row"] = 0
        self._fresh = sample

    def take(self) -> Sample | None:
        """Return the sample of this tick once; None while there is none."""
        sample, self._fresh = self._fresh, None
        return sample

    def _tick(self, sequence: int, monotonic_ns: int, stamp_ns: int) -> None:
        self._counters["requests"] += 1
        if self._waiting:
            self._counters["missing"] += 1
            self._counters["missing_in_a_row"] += 1
        self.asked = (sequence, monotonic_ns, stamp_ns)
        self._fresh = None
        self._waiting = True

    def _ask(self) -> bool:
        asked = self._tracker.ask()
        if not asked:
            self._counters["silent"] += 1
        return asked
