# SPDX-License-Identifier: Apache-2.0
"""Rate of a stream between two readings of its counter."""

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
