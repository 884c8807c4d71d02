# SPDX-License-Identifier: Apache-2.0
"""Passivity observer at the handle: finds an oscillation that the robot feeds (thesis 7.1).

Frequency alone does not tell an instability from a tremor: on a soft, badly damped load the module
oscillates at 2 to 6 Hz, where hands tremble. The direction of the power does. A hand that trembles
drives the robot, which takes power from it; a robot that drives an oscillation gives power to what
holds the handle (passivity observer: Hannaford and Ryu 2002). A spring alone takes no mean power,
so the share of the power that counts has a threshold, and motion slower than `CORNER` is left out.
A robot that pushes a hand once gives power too: only a force that has turned several times counts.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..filters import LowpassState, lowpass_coefficients, lowpass_step

CORNER = 2.0  # [Hz] twice first order, of force and velocity alike: equal phases
WINDOW = 0.1  # [s] of the means, twice exponential: passes 7 % of the power's ripple at 3 Hz
LOST_SHARE = 0.06  # -mean(F v) / (rms F rms v) from which the robot counts as the source
TURNED = 2.5  # recent reversals of the force that make an oscillation
FORGET = 1.0  # [s] time constant with which reversals are forgotten
NOTABLE = 0.25  # of the least force: a smaller one of the other sign is no reversal
LASTING = 0.2  # [s] for which the robot must have fed an oscillation
STEADY = 0.9  # least ratio of the force's mean square to its slower mean: below, it dies away


class Highpass(NamedTuple):
    """Two first-order low passes whose complements, in series, are the high pass."""

    first: LowpassState
    second: LowpassState


class Mean(NamedTuple):
    """Mean over `WINDOW`, and the mean of that mean."""

    once: float
    twice: float


class OutflowState(NamedTuple):
    """force, speed: high passes; force_square [N^2], speed_square [m^2/s^2], power: from patient to
    robot [W]; side: of the rapid force, 1 or -1; turns: recent changes of the side, older
    ones count less; lasting: time for which the robot has been the source, weighted by the excess
    [s].
    """

    force: Highpass
    speed: Highpass
    force_square: Mean
    speed_square: Mean
    power: Mean
    side: float
    turns: float
    lasting: float


_ZERO = Highpass(LowpassState(0.0, 0.0), LowpassState(0.0, 0.0))
_NONE = Mean(0.0, 0.0)
NO_OUTFLOW = OutflowState(_ZERO, _ZERO, _NONE, _NONE, _NONE, 1.0, 0.0, 0.0)


def feeds(state: OutflowState) -> bool:
    """Return whether the robot has fed an oscillation for `LASTING`."""
    return state.lasting > LASTING


def outflow_step(
    state: OutflowState, force: float, velocity: float, least: float, dt: float
) -> OutflowState:
    """Return the state after a sample, dt [s] after the last one.

    force: of the patient on the robot [N] and velocity of the nut [m/s], without a lag between
    them; least: rms of the rapid force below which nothing counts [N].
    """
    rapid, force_pass = _rapid(state.force, force, dt)
    speed, speed_pass = _rapid(state.speed, velocity, dt)
    force_square = _averaged(state.force_square, rapid * rapid, dt)
    speed_square = _averaged(state.speed_square, speed * speed, dt)
    power = _averaged(state.power, rapid * speed, dt)
    side, turns = state.side, state.turns * (1.0 - min(1.0, dt / FORGET))
    if rapid * side < -NOTABLE * least:
        side, turns = -side, turns + 1.0
    rms = math.sqrt(force_square.twice)
    source = power.twice < -LOST_SHARE * rms * math.sqrt(speed_square.twice)
    lives = force_square.once > STEADY * force_square.twice
    lasting = state.lasting
    if rms <= least or power.twice >= 0.0 or turns < TURNED:
        lasting = 0.0
    elif source and lives:  # else it keeps its value: the power ripples
        lasting += dt * rms / least
    return OutflowState(
        force_pass, speed_pass, force_square, speed_square, power, side, turns, lasting
    )


def _averaged(mean: Mean, value: float, dt: float) -> Mean:
    """Return the mean with one more value, dt [s] after the last one."""
    share = min(1.0, dt / WINDOW)
    once = mean.once + share * (value - mean.once)
    return Mean(once, mean.twice + share * (once - mean.twice))


def _rapid(state: Highpass, value: float, dt: float) -> tuple[float, Highpass]:
    """Return the part of a value that is faster than `CORNER`, and the filter's next state."""
    coefficients = lowpass_coefficients(CORNER, dt)
    slow, first = lowpass_step(coefficients, state.first, value)
    slower, second = lowpass_step(coefficients, state.second, value - slow)
    return value - slow - slower, Highpass(first, second)
