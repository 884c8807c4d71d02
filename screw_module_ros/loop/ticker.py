# SPDX-License-Identifier: Apache-2.0
"""Ticks: whole multiples of one period of the clock."""

from __future__ import annotations

from typing import NamedTuple

from ..clock import Clock

BETWEEN_TICKS_NS = 500_000
"""Delay of the slow loops after the tick [ns]: by then the fast loops have published."""
BACK_OFF_S = 100e-6
"""Sleep of a fast loop after a wake-up without work. Without it a wait set that is always ready
would make the loop spin, at a priority that blocks every other process on its core."""


class Tick(NamedTuple):
    """One multiple of the period: number, time [ns], ROS time [ns], ticks skipped before it."""

    sequence: int
    monotonic_ns: int
    stamp_ns: int
    skipped: int


class Ticker:
    """Whole multiples of `period_ns`; after an overrun it skips ticks and never bursts.

    The first tick is the first multiple after the first call, so time before the loop started is no
    overrun. offset_ns: delay after the whole multiple, for loops that only read what others publish
    on the tick.
    """

    def __init__(self, clock: Clock, period_ns: int, offset_ns: int = 0):
        self.period_ns = period_ns
        self._clock = clock
        self._offset_ns = offset_ns
        self._last: int | None = None

    def due_ns(self) -> int:
        """Return the time of the next tick [ns]."""
        if self._last is None:
            self._last = (self._clock.now_ns() - self._offset_ns) // self.period_ns
        return (self._last + 1) * self.period_ns + self._offset_ns

    def sleep(self) -> Tick:
        """Sleep until the next tick."""
        self._clock.sleep_until(self.due_ns())
        return self.take()

    def take(self) -> Tick:
        """Return the present tick; call it only after `due_ns`."""
        assert self._last is not None, "due_ns comes first"
        now_ns = self._clock.now_ns()
        number = max((now_ns - self._offset_ns) // self.period_ns, self._last + 1)
        skipped = number - self._last - 1
        self._last = number
        return Tick(number & 0xFFFFFFFF, now_ns, self._clock.stamp_ns(), skipped)


def period_of(rate: float) -> int:
    """Return the period of `rate` [Hz] in ns.

    Raises ValueError if it is not a whole number of microseconds: then the ticks of nodes whose
    periods do not divide each other would never coincide.
    """
    period_ns = round(1e9 / rate)
    if period_ns % 1000:
        raise ValueError(f"rate = {rate} Hz: its period must be a whole number of microseconds")
    return period_ns
