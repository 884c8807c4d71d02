# SPDX-License-Identifier: Apache-2.0
"""A homing that contradicts the last one needs a second call.

With a homing the operator declares that the axis stands at its reference mark. If the sensor has
counted without a gap since the last homing, the driver compares the two: a homing elsewhere would
shift soft stops and set points. Which of them is right remains unknown until the operator homes
twice, or homes where both agree. Until then the axis counts as not homed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

_SOONEST_NS, _LATEST_NS = 1_000_000_000, 15_000_000_000


class Rehoming:
    """Stores a requested homing that would move the origin; all times are passed in [ns].

    contradicted: the last homing was rejected, so the one before is in doubt too.
    """

    def __init__(self, tolerance: float):
        """tolerance: largest shift of the origin without a second call [m]."""
        self.contradicted = False
        self._tolerance = tolerance
        self._asked: tuple[int, tuple[float, ...]] | None = None

    def forget(self) -> None:
        """Drop the stored request: the sensor's count has restarted."""
        self._asked, self.contradicted = None, False

    def doubt(self, mark: Sequence[float], place: Sequence[float], now_ns: int) -> str:
        """Return why the homing is not accepted yet, empty when it is.

        mark: declared position of the axis; place: its position by the last homing, both [m]. A
        second call at the same place is accepted 1 s to 15 s after the first; an earlier one could
        be a program that retries.
        """
        shift = math.dist(mark, place)
        asked, self._asked = self._asked, None
        self.contradicted = False
        if shift <= self._tolerance:
            return ""
        if asked is not None and _SOONEST_NS <= now_ns - asked[0] <= _LATEST_NS:
            if math.dist(place, asked[1]) <= self._tolerance:
                return ""
        self._asked, self.contradicted = (now_ns, tuple(place)), True
        return (
            f"this moves the origin by {shift * 1e3:.1f} mm against the last homing, so neither "
            "counts: bring it to the reference mark; if it stands there, call ~/home again, at the "
            "earliest in 1 s and within 15 s"
        )
