# SPDX-License-Identifier: Apache-2.0
"""Limits the set points that a game requests: workspace and speed."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from ..control.limits import clamp, slew
from ..settings import Setting
from .hand import Point

_NS = 1e-9
_LONGEST = 0.2  # [s] largest interval for the speed limit: no large step after a pause
SILENT_NS = 1_000_000_000
"""After this silence a game counts as gone [ns]. The value is ours."""


class WishLimits(NamedTuple):
    """Workspace and speed of a game's set point. The bounds are ours."""

    half_width: Annotated[
        float, Setting("in x from the centre", "m", 0.0, 0.1905, live=True)
    ] = 0.15
    half_depth: Annotated[
        float, Setting("in y from the centre", "m", 0.0, 0.2286, live=True)
    ] = 0.15
    low: Annotated[float, Setting("lowest height", "m", 0.0, 0.36, live=True)] = 0.03
    high: Annotated[float, Setting("greatest height", "m", 0.0, 0.36, live=True)] = 0.33
    speed: Annotated[float, Setting("along each axis", "m/s", 0.01, 0.6, live=True)] = 0.3

    def ranges(self) -> tuple[tuple[float, float], ...]:
        """Return lowest and highest value of x, y and z [m]; if `low` is above `high`, `high`."""
        plane = (self.half_width, self.half_depth)
        return (*((-half, half) for half in plane), (min(self.low, self.high), self.high))


class WishGate:
    """Converts a game's wishes to limited set points. limits: may be replaced at any time."""

    def __init__(self, limits: WishLimits):
        self.limits = limits
        self._last: Point = (math.nan,) * 3
        self._last_ns: int | None = None

    def passed(self, wish: Point, hand: Point, now_ns: int) -> Point:
        """Return the set point for a wish [m]; NaN = no set point of an axis.

        hand: its position [m], the initial value of an axis without a set point; now_ns: time [ns].
        """
        limits = self.limits
        since = math.inf if self._last_ns is None else (now_ns - self._last_ns) * _NS
        elapsed = min(since, _LONGEST)
        ranges = limits.ranges()
        self._last_ns = now_ns
        x, y, z = (
            _moved(asked, last if math.isfinite(last) else here, limits.speed * elapsed, *bounds)
            for asked, last, here, bounds in zip(wish, self._last, hand, ranges, strict=True)
        )
        self._last = x, y, z
        return self._last

    def released(self, hand: Point, now_ns: int) -> Point | None:
        """Return the hand's position [m] once after the game has gone silent, else None.

        Otherwise the spring to the game's last set point would pull permanently. While the hand's
        position is unknown, the release waits for it.
        """
        if self._last_ns is None or now_ns - self._last_ns < SILENT_NS:
            return None
        return self.cut_off(hand)

    def cut_off(self, hand: Point) -> Point | None:
        """Return the hand's position [m] once when a game may wish no more, else None.

        As in `released`.
        """
        if self._last_ns is None or self._unknown(hand):
            return None
        self._last, self._last_ns = (math.nan,) * 3, None
        return hand

    def _unknown(self, hand: Point) -> bool:
        """Return whether the hand's position is unknown along an axis that has a set point."""
        return any(
            math.isfinite(last) and not math.isfinite(here)
            for last, here in zip(self._last, hand, strict=True)
        )


def _moved(asked: float, last: float, step: float, low: float, high: float) -> float:
    if not (math.isfinite(asked) and math.isfinite(last)):
        return math.nan
    return clamp(slew(last, asked, step), low, high)
