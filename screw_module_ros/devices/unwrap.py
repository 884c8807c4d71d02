# SPDX-License-Identifier: Apache-2.0
"""Makes a wrapping position continuous (6004 of CiA 406 wraps at 6002, 6064 of CiA 402 at 2^32)."""

from __future__ import annotations

FULL_RANGE = 1 << 32


class Unwrapper:
    """Continuous count from a position that wraps at `measuring_range` [counts].

    The first sample is read as signed, so an encoder that powers up just below zero starts at a
    small negative count. A step is the shorter of the two directions: less than half a range.
    """

    __slots__ = ("_half", "_last", "_range", "count")

    def __init__(self, measuring_range: int):
        if not 2 <= measuring_range <= FULL_RANGE:
            raise ValueError(f"measuring_range = {measuring_range}: 2 to 2^32 counts are wanted")
        self._range = measuring_range
        self._half = (measuring_range + 1) // 2
        self._last: int | None = None
        self.count = 0

    def holds(self, raw: int) -> bool:
        """Return whether the encoder can send this position at all."""
        return 0 <= raw < self._range

    def step(self, raw: int) -> int:
        """Return the continuous count [counts] for the next raw position."""
        delta = raw if self._last is None else (raw - self._last) % self._range
        if delta >= self._half:
            delta -= self._range
        self._last = raw
        self.count += delta
        return self.count
