# SPDX-License-Identifier: Apache-2.0
"""Set point of one axis: clamped to its range, limited in speed, unchanged on NaN.

The damper acts on the difference between the hand's velocity and the set point's. If a game sends a
velocity that its positions do not follow, the damper would push the hand without end, up to the
limit of the force. So each step compares the motion that the velocity promised with the motion that
the set point in use made, and keeps the debt over the last half second. A game with ten set points
a second has a debt of up to 0.1 s of motion. Above that the velocity fades. It is zero at a debt of
0.2 s, the age at which the velocity of a set point expires (`loop.inputs`). It returns when
the set point moves as promised. A velocity below the true one, zero included, is accepted: it
brakes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from .limits import clamp, slew

FULL_DEBT = 0.1
"""Debt up to which the velocity counts in full, as time at that velocity [s]."""
ZERO_DEBT = 0.2
"""Debt from which the velocity counts as zero, as time at that velocity [s]."""
FORGOTTEN = 0.5
"""Time constant with which a debt decays [s]."""


class Range(NamedTuple):
    """Limits of a set point: low to high [m], speed [m/s] and acceleration [m/s^2]."""

    low: float
    high: float
    speed: float
    acceleration: float


@dataclass(slots=True)
class SetPoint:
    """The set point in use: position [m], velocity [m/s]; owed: motion that the velocity promised
    and the position has not made [m]."""

    position: float = 0.0
    velocity: float = 0.0
    owed: float = 0.0


def hold_at(setpoint: SetPoint, position: float) -> None:
    """Bring a set point to rest at a position [m]."""
    setpoint.position, setpoint.velocity, setpoint.owed = position, 0.0, 0.0


def follow(
    allowed: Range, setpoint: SetPoint, position: float, velocity: float, dt: float
) -> None:
    """Move the set point by dt [s]; a game asks for position [m] and velocity [m/s].

    A position that is not finite brings the set point to rest where it is. A velocity that is not
    finite counts as zero; a velocity that the position does not follow fades.
    """
    moved, rate, owed = setpoint.position, 0.0, 0.0
    if math.isfinite(position):
        target = min(max(position, allowed.low), allowed.high)
        moved = slew(moved, target, allowed.speed * dt)
        if math.isfinite(velocity):
            promised = min(max(velocity, -allowed.speed), allowed.speed)
            owed = _owed(setpoint.owed, promised, moved - setpoint.position, dt)
            rate = promised * _velocity_share(promised, owed)
    setpoint.position, setpoint.owed = moved, owed
    setpoint.velocity = slew(setpoint.velocity, rate, allowed.acceleration * dt)


def _owed(owed: float, promised: float, made: float, dt: float) -> float:
    """Return the debt [m] after dt [s] of a promised velocity [m/s] and the motion made [m]."""
    debt = owed * max(0.0, 1.0 - dt / FORGOTTEN) + promised * dt - made
    if debt * promised <= 0.0:
        return 0.0  # the set point moved further than promised: no credit for later
    most = abs(promised) * ZERO_DEBT
    return clamp(debt, -most, most)


def _velocity_share(promised: float, owed: float) -> float:
    """Return the share of a velocity [m/s] that is accepted with a debt [m]."""
    if owed == 0.0:
        return 1.0
    behind = abs(owed) / abs(promised)
    return clamp((ZERO_DEBT - behind) / (ZERO_DEBT - FULL_DEBT), 0.0, 1.0)
