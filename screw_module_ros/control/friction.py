# SPDX-License-Identifier: Apache-2.0
"""Friction model of the screw module (thesis 5.2.5); `calibration.module` reads its file.

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

The thesis argues that a feed-forward fails at rest (6.3.1). Ours goes by position, as presliding
does (`hysteresis`; dahl1968). A feed-forward that is proportional to the velocity near zero is
negative damping: 2 N over 2 mm/s are 1000 Ns/m, and a handle at rest oscillates. Real friction is a
spring while the handle barely moves, so the feed-forward is one too. With a stiffness below that of
the real presliding, the sum of both remains a positive spring and a handle at rest stays at rest.
At standstill the feed-forward exchanges no energy and needs no velocity.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, NamedTuple

from ..settings import Setting
from .limits import clamp

SMALLEST_LEVEL = 0.1  # [N] keeps the length over which the modelled friction reverses finite
INFORMATIVE_SPEED = 0.005  # [m/s] slower motion and
INFORMATIVE_FORCE = 1.0  # [N] less modelled friction say nothing about the model
FALL_TIME = 0.1  # [s] time constant with which the ratio falls, for a model that is too strong
RISE_TIME = 1.0  # [s] time constant with which it rises again
NEAR_ENOUGH = 1.05  # modelled / found friction up to which all of the model is used: its scatter
_LARGEST_PLAUSIBLE = 60.0  # [N], about four times what the thesis measured


class FrictionBranch(NamedTuple):
    """Fit for one direction of motion, in the thesis's units; fields as the keys of its file.

    trend: Fp1, ripple: amplitude of Fp2, both from the highest power of the height [mm] down;
    Fv = low_gain v^low_exponent up to the break, high_slope v + high_offset above, v in mm/s.
    """

    trend: tuple[float, float, float, float, float, float, float, float]
    ripple: tuple[float, float, float, float, float, float]
    flip_below_mm: Annotated[float, Setting("below this height the ripple is turned by pi", "mm")]
    break_speed_mm_s: Annotated[float, Setting("end of the power of the speed", "mm/s", 0.0, 2e3)]
    low_gain: Annotated[float, Setting("factor of the power of the speed", "", 0.0, 100.0)]
    low_exponent: Annotated[float, Setting("exponent of the speed", "", 0.0, 2.0)]
    high_slope: Annotated[float, Setting("of the line above the break", "s/mm", -1.0, 1.0)]
    high_offset: Annotated[float, Setting("of the line above the break", "", 0.0, 100.0)]


class FrictionModel(NamedTuple):
    """Friction of the module, in the thesis's units; fields as the keys of its file.

    params/friction_thesis.yaml explains each key.
    """

    low_mm: Annotated[float, Setting("lower end of the fit", "mm", -1000.0, 1000.0)]
    high_mm: Annotated[float, Setting("upper end of the fit", "mm", -1000.0, 1000.0)]
    fastest_mm_s: Annotated[float, Setting("fastest speed measured", "mm/s", 1.0, 2000.0)]
    ramp_speed_mm_s: Annotated[
        float, Setting("below it the model goes to zero in a straight line", "mm/s", 0.1, 2000.0)
    ]
    lead_mm: Annotated[float, Setting("travel per ripple cycle", "mm", 0.1, 1000.0)]
    phase_rad: Annotated[float, Setting("of the ripple", "rad")]
    gravity_N: Annotated[float, Setting("weight included in the fits", "N", -100.0, 100.0)]
    up: FrictionBranch
    down: FrictionBranch

    def flaw(self) -> str:
        """Return an empty range, or coefficients that give an implausible force; empty if neither.

        Forces are checked at each 1 % of the range. Fv rises or falls throughout on each side of
        its break, so the ends of both sides suffice.
        """
        if not self.low_mm < self.high_mm:
            return f"high_mm: {self.high_mm:g} is not above low_mm, {self.low_mm:g}"
        if self.ramp_speed_mm_s > self.fastest_mm_s:
            return f"ramp_speed_mm_s: {self.ramp_speed_mm_s:g} is above fastest_mm_s"
        for step in range(101):
            z = (self.low_mm + (self.high_mm - self.low_mm) * step / 100.0) / 1000.0
            for name, way in (("up", 1e-3), ("down", -1e-3)):
                edge = getattr(self, name).break_speed_mm_s
                ends = (self.ramp_speed_mm_s, self.fastest_mm_s, edge * (1.0 - 1e-9),
                        edge * (1.0 + 1e-9))  # fmt: skip
                for velocity in (way * end for end in ends):
                    force = friction_force(self, z, velocity)
                    if not abs(force) <= _LARGEST_PLAUSIBLE:
                        return (
                            f"{name}: {force:.3g} N of friction at {z:.3f} m and {velocity:.3f} "
                            f"m/s, more than {_LARGEST_PLAUSIBLE:g} N: check the coefficients and "
                            "their order"
                        )
        return ""


def friction_force(model: FrictionModel, position: float, velocity: float) -> float:
    """Return the force that compensates friction [N], without gravity.

    position [m], velocity [m/s], up positive. The force acts along the motion and passes
    continuously through zero with the velocity.
    """
    speed = abs(velocity) * 1000.0
    z = clamp(position * 1000.0, model.low_mm, model.high_mm)
    branch = model.up if velocity > 0.0 else model.down
    push = _held_speed(model, branch, z) - model.gravity_N
    force = push * _speed_factor(branch, clamp(speed, model.ramp_speed_mm_s, model.fastest_mm_s))
    force *= min(1.0, speed / model.ramp_speed_mm_s)
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
        speed = math.copysign(max(abs(velocity), 1e-3 * model.ramp_speed_mm_s), travelled)
        level = max(abs(friction_force(model, position, speed)), SMALLEST_LEVEL)
        memory.modelled = hysteresis(memory.modelled, level, stiffness, travelled)


def compare_step(memory: Presliding, found: float, velocity: float, dt: float) -> None:
    """Average found / modelled friction while the nut moves; found [N], velocity [m/s], dt [s].

    A model that predicts too much friction adds energy: with that feed-forward the handle
    oscillates on any spring. The thesis fed forward 90 % (6.4.2) and gives no reason.
    """
    modelled = memory.modelled
    if abs(velocity) < INFORMATIVE_SPEED or abs(modelled) < INFORMATIVE_FORCE:
        return
    if modelled * velocity > 0.0:
        now = clamp(found / modelled, 0.0, 2.0)
        time = FALL_TIME if now < memory.ratio else RISE_TIME
        memory.ratio += (now - memory.ratio) * min(1.0, dt / time)


def model_share(memory: Presliding) -> float:
    """Return the share of the model to use, 0 to 1."""
    return min(1.0, NEAR_ENOUGH * memory.ratio)


def _held_speed(model: FrictionModel, branch: FrictionBranch, z: float) -> float:
    """Return Fp1 + Fp2 at z [mm]: the mean force at constant speed, gravity included [N]."""
    angle = 2.0 * math.pi / model.lead_mm * z + model.phase_rad
    sine = math.sin(angle) if z > branch.flip_below_mm else -math.sin(angle)
    return _polynomial(branch.trend, z) + _polynomial(branch.ripple, z) * sine


def _speed_factor(branch: FrictionBranch, speed: float) -> float:
    """Return Fv, the factor on the mean friction, at speed [mm/s] > 0."""
    if speed <= branch.break_speed_mm_s:
        return branch.low_gain * speed**branch.low_exponent
    return branch.high_slope * speed + branch.high_offset


def _polynomial(coefficients: tuple[float, ...], x: float) -> float:
    """Return the polynomial at x, coefficients from the highest power down (Horner)."""
    value = 0.0
    for coefficient in coefficients:
        value = value * x + coefficient
    return value
