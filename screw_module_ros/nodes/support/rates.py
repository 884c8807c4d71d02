# SPDX-License-Identifier: Apache-2.0
"""Rates of streams: measured from a counter, and kept by sending some messages only."""

from __future__ import annotations

import math


class RateMeter:
    """Turns a counter into a rate, from one diagnostics entry to the next."""

    def __init__(self):
        self._count = 0
        self._time_ns = 0

    def rate(self, count: int, now_ns: int) -> float:
        """Return events per second since the last call, NaN at the first and after a restart."""
        elapsed = (now_ns - self._time_ns) * 1e-9
        known = self._time_ns and elapsed > 0 and count >= self._count
        rate = (count - self._count) / elapsed if known else math.nan
        self._count, self._time_ns = count, now_ns
        return rate


class Due:
    """Says when the next message of a slower rate is due, at whole multiples of its period.

    rate: messages per second [Hz]. The first one is due at once.
    """

    def __init__(self, rate: float):
        self._period_ns = round(1e9 / rate)
        self._due_ns = 0

    def __call__(self, now_ns: int) -> bool:
        """Return whether a message is due at now_ns [ns]; True counts it as sent."""
        if now_ns < self._due_ns:
            return False
        self._due_ns = (now_ns // self._period_ns + 1) * self._period_ns
        return True
