# SPDX-License-Identifier: Apache-2.0
"""Rate of a stream over the time between two looks at its counter."""

from __future__ import annotations


class RateMeter:
    """Turns a counter into a rate, from one diagnostics entry to the next."""

    def __init__(self):
        self._count = 0
        self._time_ns = 0

    def rate(self, count: int, now_ns: int) -> float:
        """Return events per second since the last call, 0 at the first."""
        elapsed = (now_ns - self._time_ns) * 1e-9
        rate = (count - self._count) / elapsed if self._time_ns and elapsed > 0 else 0.0
        self._count, self._time_ns = count, now_ns
        return rate
