# SPDX-License-Identifier: Apache-2.0
"""Optional compensation of the plane: friction of the joints and a part of the module's mass.

The thesis leaves the plane as it is: 57 to 113 gram-force of friction and the module's 12 lb on an
arm of 4/3 kg at most (2.2.4, appendix D). Two parts reduce what the hand feels of that; both are
off by default.

- Friction: a feed-forward of each joint's friction that follows the angle as presliding does
  (`presliding`), so that it is a spring at rest and exchanges no energy there.
- Mass: a force of `carried_mass` times the estimated acceleration of the handle. A mass at the tip
  weighs the same in every direction, so this needs neither the arm's inertias nor its Jacobian's
  inverse.

The acceleration is filtered, and its lag is a negative damper, m w^2 / wc for an oscillation w. A
handle on its spring alone oscillates at w^2 = K / (M - m), M its mass: the law keeps the damper
that this needs (`least_planar_damping`). On a stiff, badly damped load the oscillation is too fast
for any damper of the law: mass is carried only in motion, and the chatter guard of the vertical
axis (`chatter`) takes it away when the carried force is rapid.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..filters import LowpassState, lowpass_coefficients, lowpass_step
from .chatter import QUIET_GUARD, GuardState, guard_step
from .hold import hold_step
from .limits import clamp

CUTOFF = 6.0
"""Corner of the acceleration's filter [Hz]: above it the hand feels the whole mass again."""
DELAY = 0.008
"""From a position to its torque, with the velocity filter of 30 Hz and 1.5 periods [s]."""
MOVING = 0.03
"""Largest recent speed along an axis from which all of the mass is carried there [m/s]."""
LARGEST = 20.0
"""Largest force that carries the mass, along each axis [N]."""
SMALLEST_TORQUE = 1e-3  # [Nm] keeps the angle over which the friction reverses finite


class CarriedAxis(NamedTuple):
    """Memory of one axis: low pass of the velocity [m/s], its largest recent size [m/s], guard of
    the carried mass."""

    lowpass: LowpassState
    fastest: float
    guard: GuardState


AT_REST = CarriedAxis(LowpassState(0.0, 0.0), 0.0, QUIET_GUARD)


def carried_force(
    state: CarriedAxis, velocity: float, mass: float, limit: float, dt: float
) -> tuple[float, CarriedAxis]:
    """Return the force that carries a mass along one axis [N], and the next state.

    velocity: of the handle [m/s]; mass: to carry [kg]; limit: rms of the rapid force from which the
    guard acts [N]; dt [s].
    """
    slow, lowpass = lowpass_step(lowpass_coefficients(CUTOFF, dt), state.lowpass, velocity)
    fastest = hold_step(state.fastest, slow, dt)
    acceleration = 2.0 * math.pi * CUTOFF * (velocity - slow)
    force = min(1.0, fastest / MOVING) * mass * acceleration
    guard = guard_step(state.guard, force, False, limit, dt)
    return guard.share * clamp(force, -LARGEST, LARGEST), CarriedAxis(lowpass, fastest, guard)


def friction_torque(level: float, stiffness: float, torque: float, turned: float) -> float:
    """Return the torque that compensates a joint's friction [Nm], positive along the motion.

    level: friction of the joint, 0 = none [Nm]; stiffness: of the reversal [Nm/rad]; torque: last
    returned value [Nm]; turned: since the last step [rad].
    """
    if level < SMALLEST_TORQUE:
        return 0.0
    if turned == 0.0:
        return clamp(torque, -level, level)
    way = math.copysign(level, turned)
    kept = math.exp(-stiffness * abs(turned) / level)
    return clamp(way + (torque - way) * kept, -level, level)


def least_planar_damping(stiffness: float, mass: float, carried: float) -> float:
    """Return the damper with which a released handle comes to rest [Ns/m], 0 without carried mass.

    stiffness K [N/m]; mass M: of module and arm at the handle [kg]; carried: m < M [kg]. The lag of
    the acceleration's filter takes m K / ((M - m) wc), the delay of spring and force K M / (M - m)
    times the delay.
    """
    if carried <= 0.0:
        return 0.0
    left = mass - carried
    return stiffness * (carried / (left * 2.0 * math.pi * CUTOFF) + mass / left * DELAY)
