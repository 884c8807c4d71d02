# SPDX-License-Identifier: Apache-2.0
"""The centre-out reach of MANUS therapy: to eight targets on a circle and back, one by one."""

from __future__ import annotations

import math
from typing import NamedTuple

RADIUS = 0.10
"""From the workspace centre to each target [m]."""
TARGETS = 8


class Way(NamedTuple):
    """One straight way of the reach.

    begin [s] and duration [s]; start and end: x, y from the workspace centre [m].
    """

    begin: float
    duration: float
    start: tuple[float, float]
    end: tuple[float, float]


def targets() -> list[tuple[float, float]]:
    """Return the targets x, y [m], evenly on the circle, beginning away from the patient."""
    angles = [math.pi / 2 - 2 * math.pi * number / TARGETS for number in range(TARGETS)]
    return [(RADIUS * math.cos(angle), RADIUS * math.sin(angle)) for angle in angles]


def centre_out(duration: float, points: list[tuple[float, float]], rest: float = 0.1) -> list[Way]:
    """Return the ways to each point and back within `duration` [s].

    rest: share of each way's time spent standing at its end. Raises ValueError where there is no
    time to move.
    """
    if not (duration > 0.0 and points and 0.0 <= rest < 1.0):
        raise ValueError(
            f"duration = {duration} s for {len(points)} points, rest = {rest}: no time to move"
        )
    each = duration / (2 * len(points))
    ways = []
    for number, point in enumerate(points):
        begin = 2 * number * each
        ways.append(Way(begin, each * (1.0 - rest), (0.0, 0.0), point))
        ways.append(Way(begin + each, each * (1.0 - rest), point, (0.0, 0.0)))
    return ways


def on_way(way: Way, time: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return position [m] and velocity [m/s] at `time` [s]: minimum jerk (Flash and Hogan 1985)."""
    share = min(max((time - way.begin) / way.duration, 0.0), 1.0)
    gone = share**3 * (10.0 - 15.0 * share + 6.0 * share * share)
    pace = 30.0 * (share * (1.0 - share)) ** 2 / way.duration
    (x0, y0), (x1, y1) = way.start, way.end
    return (x0 + gone * (x1 - x0), y0 + gone * (y1 - y0)), (pace * (x1 - x0), pace * (y1 - y0))
