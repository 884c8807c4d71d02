# SPDX-License-Identifier: Apache-2.0
"""Set point of one axis: held in its range, moved no faster than a limit, left alone on NaN.

The velocity of a set point is what the damper acts against. It counts only as far as the set point
moves that way: with a velocity that the position does not follow the damper would push the hand for
ever, up to the limit of the force. So each step notes what the velocity promised and the set point
in use did not make, over the last half second. A debt of up to 0.1 s of motion is what a game has
that sends ten set points a second; from there on the velocity fades, and at 0.2 s, the age at which
a set point's velocity ends anyway (`loop.setpoint_input`), nothing of it is left. It comes back
when the set point moves as promised. A velocity below the true one, zero included, is accepted: it
brakes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from .limits import clamp, slew

BELIEVED = 0.1
"""Motion that a velocity may be ahead of its set point [s]."""
DISBELIEVED = 0.2
"""Motion from which on nothing of the velocity is left [s]."""
_FORGOTTEN = 0.5  # [s] time constant in which a debt goes


class Range(NamedTuple):
    """Where a set point may be, low to high [m], its speed [m/s] and acceleration [m/s^2]."""

    low: float
    high: float
    speed: float
    acceleration: float


class SetPoint(NamedTuple):
    """The set point in use: position [m], velocity [m/s]; owed: motion its velocity promised that
    its position has not made [m]."""

    position: float
    velocity: float
    owed: float


def at_rest(position: float) -> SetPoint:
    """Return a set point that stands at a position [m]."""
    return SetPoint(position, 0.0, 0.0)


def follow(
    allowed: Range, setpoint: SetPoint, position: float, velocity: float, dt: float
) -> SetPoint:
    """Return the set point dt [s] later, when a game asks for position [m] and velocity [m/s].

    A position that is not finite leaves the set point where it is and brings it to rest; a velocity
    that is not finite counts as zero, one that the position does not follow fades.
    """
    moved, rate, owed = setpoint.position, 0.0, 0.0
    if math.isfinite(position):
        target = clamp(position, allowed.low, allowed.high)
        moved = slew(moved, target, allowed.speed * dt)
        if math.isfinite(velocity):
            promised = clamp(velocity, -allowed.speed, allowed.speed)
            owed = _owed(setpoint.owed, promised, moved - setpoint.position, dt)
            rate = promised * _belief(promised, owed)
    return SetPoint(moved, slew(setpoint.velocity, rate, allowed.acceleration * dt), owed)


def _owed(owed: float, promised: float, made: float, dt: float) -> float:
    """Return the debt [m] after dt [s] of a promised velocity [m/s] and the motion made [m]."""
    debt = owed * max(0.0, 1.0 - dt / _FORGOTTEN) + promised * dt - made
    if debt * promised <= 0.0:
        return 0.0  # more than was promised, or another direction: no credit for later
    most = abs(promised) * DISBELIEVED
    return clamp(debt, -most, most)


def _belief(promised: float, owed: float) -> float:
    """Return the share of a velocity [m/s] that is accepted with a debt [m]."""
    if owed == 0.0:
        return 1.0
    behind = abs(owed) / abs(promised)
    return clamp((DISBELIEVED - behind) / (DISBELIEVED - BELIEVED), 0.0, 1.0)
