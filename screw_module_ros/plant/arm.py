# SPDX-License-Identifier: Apache-2.0
"""The simulated patient: an arm whose virtual hand follows a path, and the positioning stage.

The arm is the thesis's (6.4.3): mass, spring and damper between the handle and a virtual hand that
moves on a minimum-jerk path (Flash and Hogan 1985) to a target and there follows a sine. Kinds:

- active: the arm as set;
- relaxed: a tenth of the stiffness, no sine: it is moved, it does not move;
- tremor: active, with a 5 Hz sine of 8 mm on each axis of the virtual hand;
- weak: active, but spring and damper together cannot exceed 8 N.

The arm's mass moves with the handle. The patient carries its weight, except for the share `carried`
that rests on the handle.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from ..settings import Setting

ACTIVE, RELAXED, TREMOR, WEAK = "active", "relaxed", "tremor", "weak"
KINDS = (ACTIVE, RELAXED, TREMOR, WEAK)
RELAXED_SHARE = 0.1  # of the stiffness
TREMOR_AMPLITUDE = 0.008  # of the virtual hand [m]
TREMOR_OMEGA = 2.0 * math.pi * 5.0  # within the 4-6 Hz of rest tremor [rad/s]
WEAK_FORCE = 8.0  # the most a weak arm pushes or pulls [N]


class HumanArm(NamedTuple):
    """The patient's arm at the start of the rig."""

    kind: Annotated[str, Setting("what the arm does", choices=KINDS)]
    mass: Annotated[float, Setting("moved with the handle", "kg", 0.0, 60.0)]
    stiffness: Annotated[float, Setting("towards the virtual hand", "N/m", 0.0, 5000.0)]
    damping: Annotated[float, Setting("towards the virtual hand", "N s/m", 0.0, 500.0)]
    carried: Annotated[float, Setting("share of its weight on the handle", "", 0.0, 1.0)]


class ArmForce(NamedTuple):
    """The arm in the equations of motion, the same on every axis.

    mass [kg], stiffness [N/m], damping [N s/m], limit: of spring and damper together [N],
    weight: on the handle [N].
    """

    mass: float
    stiffness: float
    damping: float
    limit: float
    weight: float


class HandPath(NamedTuple):
    """Path of the virtual hand on one axis.

    start, target [m]; begin: time it starts [s]; duration: of the minimum-jerk part [s];
    amplitude [m] and omega [rad/s]: of the sine about the target, from then on;
    tremor: amplitude of the tremor [m].
    """

    start: float
    target: float
    begin: float
    duration: float
    amplitude: float
    omega: float
    tremor: float


def arm_force(arm: HumanArm, gravity: float) -> ArmForce:
    """Return the arm for the equations of motion; gravity [m/s^2]."""
    relaxed = RELAXED_SHARE if arm.kind == RELAXED else 1.0
    return ArmForce(
        mass=arm.mass,
        stiffness=arm.stiffness * relaxed,
        damping=arm.damping,
        limit=WEAK_FORCE if arm.kind == WEAK else math.inf,
        weight=arm.mass * gravity * arm.carried,
    )


def resting(position: float) -> HandPath:
    """Return the path of a virtual hand that stays at a position [m]."""
    return HandPath(position, position, 0.0, 0.0, 0.0, 0.0, 0.0)


def hand_point(path: HandPath, time: float) -> tuple[float, float]:
    """Return position [m] and velocity [m/s] of the virtual hand at a time [s]."""
    position = path.target
    velocity = 0.0
    since = time - path.begin - path.duration
    if since < 0.0:
        share = min(max((time - path.begin) / path.duration, 0.0), 1.0)
        way = path.target - path.start
        cubed = share * share * share
        position = path.start + way * cubed * (10.0 + share * (6.0 * share - 15.0))
        rest = share * (1.0 - share)
        velocity = way / path.duration * 30.0 * rest * rest
    else:
        position += path.amplitude * math.sin(path.omega * since)
        velocity += path.amplitude * path.omega * math.cos(path.omega * since)
    if path.tremor != 0.0:
        position += path.tremor * math.sin(TREMOR_OMEGA * time)
        velocity += path.tremor * TREMOR_OMEGA * math.cos(TREMOR_OMEGA * time)
    return position, velocity


def spring_terms(
    arm: ArmForce, hand: float, hand_velocity: float, position: float, velocity: float
) -> tuple[float, float, float]:
    """Return (stiffness, damping, constant force) that act over one substep on one axis.

    A weak arm at its limit is a constant force. hand, position [m]; velocities [m/s].
    """
    force = arm.stiffness * (hand - position) + arm.damping * (hand_velocity - velocity)
    if force > arm.limit:
        return 0.0, 0.0, arm.limit
    if force < -arm.limit:
        return 0.0, 0.0, -arm.limit
    return arm.stiffness, arm.damping, 0.0


def stage_velocity(
    position: float, velocity: float, speed: float, target: float, acceleration: float, dt: float
) -> float:
    """Return the positioning stage's velocity [m/s] after a substep.

    The stage moves to `target` [m] at `speed` [m/s] and stops there; its speed always allows it to
    brake with `acceleration` [m/s^2]. position [m], velocity: now [m/s], dt [s].
    """
    way = target - position
    step = acceleration * dt
    braking = math.sqrt(0.25 * step * step + 2.0 * acceleration * abs(way)) - 0.5 * step
    wanted = math.copysign(min(speed, braking, abs(way) / dt), way)
    return min(max(wanted, velocity - step), velocity + step)
