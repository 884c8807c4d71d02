# SPDX-License-Identifier: Apache-2.0
"""Ticks: whole multiples of one period of the clock."""

from __future__ import annotations

from typing import NamedTuple

from ..clock import Clock

BETWEEN_TICKS_NS = 500_000
"""How long after the tick the slow loops look: by then those that tick fast have said all [ns]."""
BACK_OFF_S = 100e-6
"""A hot loop that was woken for nothing sleeps so long before it waits again: a wait set that is
always ready would else make it spin, at a priority at which nobody else on its core runs."""


class Tick(NamedTuple):
    """One multiple of the period: number, time [ns], ROS time [ns], ticks left out before."""

    sequence: int
    monotonic_ns: int
    stamp_ns: int
    skipped: int


class Ticker:
    """Whole multiples of `period_ns`; an overrun skips ticks, never bursts.

    The first is the one after it is first asked: what passed before the loop ran is no overrun.
    offset_ns: how long after the whole multiple the tick is, for loops that only look at what
    others do on it.
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
        """Return the tick of now; the caller has seen by `due_ns` that it is due."""
        now_ns = self._clock.now_ns()
        number = max((now_ns - self._offset_ns) // self.period_ns, self._last + 1)
        skipped = number - self._last - 1
        self._last = number
        return Tick(number & 0xFFFFFFFF, now_ns, self._clock.stamp_ns(), skipped)


def period_of(rate: float) -> int:
    """Return the period of `rate` [Hz] in ns.

    Raises ValueError where it is no whole number of microseconds: ticks of nodes whose periods do
    not divide each other would never line up.
    """
    period_ns = round(1e9 / rate)
    if period_ns % 1000:
        raise ValueError(f"rate = {rate} Hz: its period must be a whole number of microseconds")
    return period_ns
