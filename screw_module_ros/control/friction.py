# SPDX-License-Identifier: Apache-2.0
"""Friction model of the screw module (thesis 5.2.5); `calibration.friction_file` reads its file.

The thesis fits the force that pushes the handle at a constant speed, gravity included, separately
for up and down: Ff = Fv(v) (Fp1(z) + Fp2(z) - 10 N) + 10 N. Fp1 is the trend along the screw, Fp2
the ripple of one cycle per turn, Fv the speed factor. The 10 N of gravity belong to the
controller's gravity term; `friction_force` is the friction alone, Fv (Fp1 + Fp2 - 10 N).

Three things differ from the thesis. The position is clamped to the fitted range and the speed to
the fastest measured one, so that the polynomials are never extrapolated. Below `ramp_speed` the
speed factor falls linearly to zero instead of as |v|^0.15, whose slope at rest is infinite: one
encoder count moves the filtered velocity by up to 0.18 mm/s (count / time constant of the 30 Hz
filter), and the power law would turn that into half of the friction. With a ramp of 2 mm/s one
count changes the force by at most 0.18 / 2 x 0.9 x 14.8 N (the mean friction at the top) = 1.2 N.
Above the ramp the thesis's model is unchanged.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from .limits import clamp


class FrictionBranch(NamedTuple):
    """Fit for one direction of motion, in the thesis's units (mm, mm/s, N).

    trend: 8 coefficients of Fp1, highest power first; ripple: 6 coefficients of the amplitude of
    Fp2, highest power first; flip_below: below this position [mm] the ripple is turned by pi;
    Fv = low_gain v^low_exponent up to break_speed [mm/s], high_slope v + high_offset above.
    """

    trend: tuple[float, ...]
    ripple: tuple[float, ...]
    flip_below: float
    break_speed: float
    low_gain: float
    low_exponent: float
    high_slope: float
    high_offset: float


class FrictionModel(NamedTuple):
    """Friction of the module, in the thesis's units.

    low, high: range of the fit [mm]; fastest: fastest speed measured [mm/s]; ramp_speed: below it
    the model goes to zero in a straight line [mm/s]; lead: travel per ripple cycle [mm]; phase of
    the ripple [rad]; gravity: the weight included in the fits [N].
    """

    low: float
    high: float
    fastest: float
    ramp_speed: float
    lead: float
    phase: float
    gravity: float
    up: FrictionBranch
    down: FrictionBranch


def friction_force(model: FrictionModel, position: float, velocity: float) -> float:
    """Return the force that compensates friction [N], without gravity.

    position [m], velocity [m/s], up positive. The force acts along the motion and passes
    continuously through zero with the velocity.
    """
    speed = abs(velocity) * 1000.0
    z = clamp(position * 1000.0, model.low, model.high)
    branch = model.up if velocity > 0.0 else model.down
    push = _held_speed(model, branch, z) - model.gravity
    force = push * _speed_factor(branch, clamp(speed, model.ramp_speed, model.fastest))
    force *= min(1.0, speed / model.ramp_speed)
    return max(0.0, force) if velocity > 0.0 else min(0.0, force)


def _held_speed(model: FrictionModel, branch: FrictionBranch, z: float) -> float:
    """Return Fp1 + Fp2 at z [mm]: the mean force at constant speed, gravity included [N]."""
    angle = 2.0 * math.pi / model.lead * z + model.phase
    sine = math.sin(angle) if z > branch.flip_below else -math.sin(angle)
    return _polynomial(branch.trend, z) + _polynomial(branch.ripple, z) * sine


def _speed_factor(branch: FrictionBranch, speed: float) -> float:
    """Return Fv, the factor on the mean friction, at speed [mm/s] > 0."""
    if speed <= branch.break_speed:
        return branch.low_gain * speed**branch.low_exponent
    return branch.high_slope * speed + branch.high_offset


def _polynomial(coefficients: tuple[float, ...], x: float) -> float:
    """Return the polynomial at x, coefficients from the highest power down (Horner)."""
    value = 0.0
    for coefficient in coefficients:
        value = value * x + coefficient
    return value
