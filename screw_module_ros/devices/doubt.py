# SPDX-License-Identifier: Apache-2.0
"""The rule for every reference that an operator declares: of two that differ, which one is right?

With a homing he declares that an axis stands at its reference mark, with a tare that nobody holds
the handle. If the sensor has measured without a gap since the last one, another one elsewhere would
shift soft stops and set points, or take a patient's push for no force.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

HOMING = (
    "this moves the origin by {:.1f} mm against the last homing, so neither counts: bring it to "
    "the reference mark; if it stands there, call ~/home again, at the earliest in 1 s and within "
    "15 s"
)
TARE = (
    "this moves the zero by {:.1f} N against the last tare, so neither counts: let the handle go; "
    "if nobody holds it, call ~/tare again, at the earliest in 1 s and within 15 s"
)
_SOONEST_NS, _LATEST_NS = 1_000_000_000, 15_000_000_000


class Doubt:
    """A reference that contradicts the last one needs a second call; all times are passed in [ns].

    Which of the two is right remains unknown until the operator declares the same twice, or one
    where both agree. Until then neither counts.

    contradicted: the last reference was rejected, so the one before is in doubt too.
    """

    def __init__(self, tolerance: float, sentence: str, scale: float = 1.0):
        """tolerance: largest shift without a second call [unit]; sentence: of the refusal, with
        the shift times scale."""
        self._tolerance, self._sentence, self._scale = tolerance, sentence, scale
        self.forget()

    def forget(self) -> None:
        """Drop the stored call: what the sensor measures has begun anew."""
        self._asked: tuple[int, tuple[float, ...]] | None = None
        self.contradicted = False

    def refusal(self, declared: Sequence[float], seen: Sequence[float], now_ns: int) -> str:
        """Return why the reference is not accepted yet, empty when it is.

        declared: what the operator says is there; seen: what is there by the last reference, both
        [unit]. A second call with the same is accepted 1 s to 15 s after the first; an earlier one
        could be a program that retries.
        """
        shift = math.dist(declared, seen)
        asked = self._asked
        self.forget()
        if shift <= self._tolerance:
            return ""
        if asked is not None and _SOONEST_NS <= now_ns - asked[0] <= _LATEST_NS:
            if math.dist(seen, asked[1]) <= self._tolerance:
                return ""
        self._asked, self.contradicted = (now_ns, tuple(seen)), True
        return self._sentence.format(shift * self._scale)
