# SPDX-License-Identifier: Apache-2.0
"""A homing that contradicts the last one is asked for twice.

Homing is a person's word that the axis stands at its reference mark. Where the sensor has counted
all the time since the last homing, the two can be compared: a homing elsewhere would move soft
stops and set points by the difference. Which is right remains unknown until the operator homes
twice, or homes where both agree; until then the axis counts as not homed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

_SOONEST_NS, _LATEST_NS = 1_000_000_000, 15_000_000_000


class Rehoming:
    """Remembers a homing that was asked for and moves the origin; all times are passed in [ns].

    contradicted: the last homing was rejected, so the one before is in doubt too.
    """

    def __init__(self, tolerance: float):
        """tolerance: the origin may move so far without a second word [m]."""
        self.contradicted = False
        self._tolerance = tolerance
        self._asked: tuple[int, tuple[float, ...]] | None = None

    def forget(self) -> None:
        """Forget what was asked: the sensor counts anew."""
        self._asked, self.contradicted = None, False

    def doubt(self, mark: Sequence[float], place: Sequence[float], now_ns: int) -> str:
        """Return why the homing is not accepted yet, empty when it is.

        mark: where the axis is said to stand; place: where it stands by the last homing, both [m].
        A second call at the same place is accepted 1 s to 15 s after the first; earlier it could be
        a program that retries.
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
