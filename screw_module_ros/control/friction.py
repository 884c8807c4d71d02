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

A law feeds the friction forward by position, as presliding goes (`hysteresis`; Dahl 1968; thesis
6.3.1). A feed-forward that is proportional to the velocity near zero is negative damping: 2 N over
2 mm/s are 1000 Ns/m, and a handle at rest oscillates. Real friction is a spring while the handle
barely moves, so the feed-forward is one too. With a stiffness below that of the real presliding,
the sum of both remains a positive spring and a handle at rest stays at rest. At standstill the
feed-forward exchanges no energy and needs no velocity.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from .limits import clamp

SMALLEST_LEVEL = 0.1  # [N] keeps the length over which the modelled friction reverses finite
INFORMATIVE_SPEED = 0.005  # [m/s] slower motion and
INFORMATIVE_FORCE = 1.0  # [N] less modelled friction say nothing about the model
FALL_TIME = 0.1  # [s] time constant with which the ratio falls, for a model that is too strong
RISE_TIME = 1.0  # [s] time constant with which it rises again
NEAR_ENOUGH = 1.05  # modelled / found friction up to which all of the model is used: its scatter


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


def hysteresis(force: float, level: float, stiffness: float, travelled: float) -> float:
    """Return the friction that is fed forward, positive along the motion, after a way.

    With each length dx it approaches the level L of that direction over a length of L / stiffness:
    h = L - (L - h) exp(-stiffness dx / L), likewise downward. For a joint, read torque and angle:

    force: last returned value [N]; level: friction in steady motion, above 0 [N]; stiffness: of the
    reversal [N/m]; travelled: since the last step, signed [m].
    """
    if travelled == 0.0:
        return force
    toward = math.copysign(level, travelled)
    return toward + (force - toward) * math.exp(-stiffness * abs(travelled) / level)


@dataclass(slots=True)
class Presliding:
    """Memory of the friction that is fed forward: modelled, at full size and positive along the
    motion [N]; ratio: of the friction that was found to it."""

    modelled: float = 0.0
    ratio: float = 1.0


def presliding_step(
    memory: Presliding,
    model: FrictionModel,
    stiffness: float,
    position: float,
    velocity: float,
    travelled: float,
) -> None:
    """Follow the nut: position [m], velocity [m/s], travelled since the last step [m].

    stiffness: of the reversal [N/m].
    """
    if travelled != 0.0:
        speed = math.copysign(max(abs(velocity), 1e-3 * model.ramp_speed), travelled)
        level = max(abs(friction_force(model, position, speed)), SMALLEST_LEVEL)
        memory.modelled = hysteresis(memory.modelled, level, stiffness, travelled)


def compare_step(memory: Presliding, found: float, velocity: float, dt: float) -> None:
    """Average found / modelled friction while the nut moves; found [N], velocity [m/s], dt [s].

    A model that predicts too much friction adds energy: with that feed-forward the handle
    oscillates on any spring. For this reason the thesis feeds forward 90 % (6.3.1).
    """
    modelled = memory.modelled
    if abs(velocity) < INFORMATIVE_SPEED or abs(modelled) < INFORMATIVE_FORCE:
        return
    if modelled * velocity > 0.0:
        now = clamp(found / modelled, 0.0, 2.0)
        time = FALL_TIME if now < memory.ratio else RISE_TIME
        memory.ratio += (now - memory.ratio) * min(1.0, dt / time)


def trusted(memory: Presliding) -> float:
    """Return the share of the model to use, 0 to 1."""
    return min(1.0, NEAR_ENOUGH * memory.ratio)


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
