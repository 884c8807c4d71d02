# SPDX-License-Identifier: Apache-2.0
"""Set point of one axis: held in its range, moved no faster than a limit, left alone on NaN."""

from __future__ import annotations

import math
from typing import NamedTuple

from .limits import clamp, slew


class Range(NamedTuple):
    """Where a set point may be, low to high [m], its speed [m/s] and acceleration [m/s^2]."""

    low: float
    high: float
    speed: float
    acceleration: float


class SetPoint(NamedTuple):
    """The set point in use: position [m], velocity [m/s]."""

    position: float
    velocity: float


def follow(
    allowed: Range, setpoint: SetPoint, position: float, velocity: float, dt: float
) -> SetPoint:
    """Return the set point dt [s] later, when a game asks for position [m] and velocity [m/s].

    A position that is not finite leaves the set point where it is and brings it to rest; a velocity
    that is not finite counts as zero.
    """
    moved, rate = setpoint.position, 0.0
    if math.isfinite(position):
        target = clamp(position, allowed.low, allowed.high)
        moved = slew(moved, target, allowed.speed * dt)
        if math.isfinite(velocity):
            rate = clamp(velocity, -allowed.speed, allowed.speed)
    return SetPoint(moved, slew(setpoint.velocity, rate, allowed.acceleration * dt))
