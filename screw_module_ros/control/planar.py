# SPDX-License-Identifier: Apache-2.0
"""The whole planar law: an impedance at the handle through the Jacobian (MIT-MANUS, thesis 3.3).

::

    set point -> spring and damper in x and y -> speed limit -> workspace -> force limit
              -> torque = J^T force -> joint limits, torque limits, again force limit
              -> rate limit -> torques

F = K (x_d - x) + B (v_d - v), eq 3.3; tau = J^T F with absolute joint angles. The law multiplies
with the Jacobian and never inverts it, so a stretched arm is no special case. As in the vertical
law nothing jumps: the force fades in after enabling, impedance and set point move at limited rates,
and each torque changes by at most `torque_rate` dt per step (0.6 Nm at 500 Hz by default). Only a
step to zero is exempt. Friction of the joints and a part of the module's mass can be compensated
(`planar_compensation`); both are off by default.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..geometry import MANUS, forward, jacobian
from .hand_force import within_at_hand
from .impedance import spring_damper
from .limits import clamp, limit_speed, slew, soft_stop
from .planar_compensation import (
    AT_REST,
    CarriedAxis,
    carried_force,
    friction_torque,
    least_planar_damping,
)
from .planar_settings import PlanarSettings
from .setpoint import Range, SetPoint, at_rest, follow

LONGEST_STEP = 0.02  # [s]; a longer dt counts as this one, so that a pause makes no large step
# A sample beyond these cannot be real; the output is then zero.
LARGEST_ANGLE = 10.0  # [rad]
FASTEST_JOINT = 100.0  # [rad/s]
STRONGEST = 1e5  # [N]


class PlanarInput(NamedTuple):
    """Inputs of one step.

    shoulder, elbow: absolute joint angles [rad]; shoulder_velocity, elbow_velocity [rad/s];
    setpoint_x, setpoint_y [m] from the workspace centre, NaN = leave that axis alone;
    setpoint_vx, setpoint_vy [m/s]; active: False holds the torques at zero and the set point at the
    measured position; slot_x, slot_y: force of a slot (`slot`) [N]; slot_weight: 0 to 1, the share
    of spring and damper that the slot replaces.
    """

    shoulder: float
    elbow: float
    shoulder_velocity: float
    elbow_velocity: float
    setpoint_x: float
    setpoint_y: float
    setpoint_vx: float
    setpoint_vy: float
    active: bool
    slot_x: float = 0.0
    slot_y: float = 0.0
    slot_weight: float = 0.0


class PlanarOutput(NamedTuple):
    """Torques and the quantities behind them.

    shoulder_torque, elbow_torque [Nm]; force_x, force_y: desired force on the handle before the
    joints' limits [N]; x, y [m] and vx, vy [m/s]: handle; desired_x, desired_y [m]: set point in
    use; saturated: a limit acted.
    """

    shoulder_torque: float
    elbow_torque: float
    force_x: float
    force_y: float
    x: float
    y: float
    vx: float
    vy: float
    desired_x: float
    desired_y: float
    saturated: bool


class PlanarState(NamedTuple):
    """Memory of the law.

    x, y: set point in use; stiffness [N/m] and damping [Ns/m] in use; weight of the force, 0 to 1;
    shoulder_torque, elbow_torque: last command [Nm]; carried_x, carried_y: of the mass that is
    carried; shoulder, elbow: last angles [rad]; shoulder_friction, elbow_friction: modelled [Nm].
    """

    x: SetPoint
    y: SetPoint
    stiffness: float
    damping: float
    weight: float
    shoulder_torque: float
    elbow_torque: float
    carried_x: CarriedAxis
    carried_y: CarriedAxis
    shoulder: float
    elbow: float
    shoulder_friction: float
    elbow_friction: float


def initial_state(settings: PlanarSettings) -> PlanarState:
    """Return the state before the first step: everything at zero."""
    return _idle(settings, 0.0, 0.0)


def planar_step(
    settings: PlanarSettings,
    state: PlanarState,
    inp: PlanarInput,
    dt: float,
) -> tuple[PlanarOutput, PlanarState]:
    """Return torques and next state, dt [s] after the last step.

    An input that is not finite or not plausible gives zero output; the caller latches a fault.
    """
    if not _usable(inp, dt):
        idle = _idle(settings, state.x.position, state.y.position)
        return _nothing(state.x.position, state.y.position, 0.0, 0.0, idle), idle
    dt = min(dt, LONGEST_STEP)
    x, y = forward(inp.shoulder, inp.elbow, MANUS)
    x_s, x_e, y_s, y_e = jacobian(inp.shoulder, inp.elbow, MANUS)
    vx = x_s * inp.shoulder_velocity + x_e * inp.elbow_velocity
    vy = y_s * inp.shoulder_velocity + y_e * inp.elbow_velocity
    if not inp.active:
        idle = _idle(settings, x, y, inp.shoulder, inp.elbow)
        return _nothing(x, y, vx, vy, idle), idle

    start = state
    if state.weight == 0.0:
        start = _idle(settings, x, y, inp.shoulder, inp.elbow)
    to_x, to_y = start.x, start.y
    if inp.slot_weight >= 1.0:
        # While a slot guides the hand the set point follows it: leaving the slot causes no pull.
        to_x, to_y = _set_point_at(settings, x, y)
    if inp.slot_weight < 1.0:
        half_x, half_y = settings.half_width, settings.half_depth
        to_x = _followed(settings, half_x, to_x, inp.setpoint_x, inp.setpoint_vx, dt)
        to_y = _followed(settings, half_y, to_y, inp.setpoint_y, inp.setpoint_vy, dt)
    stiffness = slew(state.stiffness, settings.stiffness, settings.stiffness_rate * dt)
    enough = max(
        settings.damping,
        least_planar_damping(stiffness, settings.module_mass, settings.carried_mass),
    )
    damping = slew(state.damping, enough, settings.damping_rate * dt)
    weight = min(1.0, state.weight + dt / settings.fade_time)

    spring_x = spring_damper(stiffness, damping, to_x.position - x, to_x.velocity - vx)
    spring_y = spring_damper(stiffness, damping, to_y.position - y, to_y.velocity - vy)
    asked_x = (1.0 - inp.slot_weight) * spring_x + inp.slot_x
    asked_y = (1.0 - inp.slot_weight) * spring_y + inp.slot_y
    carried_x, kept_x = carried_force(
        start.carried_x, vx, settings.carried_mass, settings.carried_limit, dt
    )
    carried_y, kept_y = carried_force(
        start.carried_y, vy, settings.carried_mass, settings.carried_limit, dt
    )
    asked_x, asked_y = asked_x + carried_x, asked_y + carried_y
    kept = _within(settings.force_limit, asked_x, asked_y)
    force_x = _bounded(settings, asked_x * kept, x, vx, settings.half_width)
    force_y = _bounded(settings, asked_y * kept, y, vy, settings.half_depth)
    again = weight * _within(settings.force_limit, force_x, force_y)
    force_x, force_y = force_x * again, force_y * again

    wanted_s, wanted_e = x_s * force_x + y_s * force_y, x_e * force_x + y_e * force_y
    friction_s, friction_e = _friction(settings, start, inp)
    wanted_s, wanted_e = wanted_s + weight * friction_s, wanted_e + weight * friction_e
    allowed = _limited_torques(settings, weight, inp, wanted_s, wanted_e)
    allowed_s, allowed_e = within_at_hand(
        settings.force_limit, MANUS, (x_s, x_e, y_s, y_e), allowed
    )
    shoulder, elbow = _slewed(state, allowed_s, allowed_e, settings.torque_rate * dt)
    limited = kept < 1.0 or again < weight or shoulder != wanted_s or elbow != wanted_e
    output = PlanarOutput(
        shoulder, elbow, force_x, force_y, x, y, vx, vy, to_x.position, to_y.position, limited
    )
    return output, PlanarState(
        to_x, to_y, stiffness, damping, weight, shoulder, elbow, kept_x, kept_y, inp.shoulder,
        inp.elbow, friction_s, friction_e,
    )  # fmt: skip


def _usable(inp: PlanarInput, dt: float) -> bool:
    """Return whether the measurements can be real; comparisons with NaN are false."""
    return (
        abs(inp.shoulder) <= LARGEST_ANGLE
        and abs(inp.elbow) <= LARGEST_ANGLE
        and abs(inp.shoulder_velocity) <= FASTEST_JOINT
        and abs(inp.elbow_velocity) <= FASTEST_JOINT
        and abs(inp.slot_x) <= STRONGEST
        and abs(inp.slot_y) <= STRONGEST
        and 0.0 <= inp.slot_weight <= 1.0
        and dt > 0.0
    )


def _idle(
    settings: PlanarSettings, x: float, y: float, shoulder: float = 0.0, elbow: float = 0.0
) -> PlanarState:
    """Return the state in which nothing is commanded, set point at x, y [m], joints at their angles
    [rad]."""
    set_x, set_y = _set_point_at(settings, x, y)
    return PlanarState(
        set_x, set_y, settings.stiffness, settings.damping, 0.0, 0.0, 0.0, AT_REST, AT_REST,
        shoulder, elbow, 0.0, 0.0,
    )  # fmt: skip


def _set_point_at(settings: PlanarSettings, x: float, y: float) -> tuple[SetPoint, SetPoint]:
    """Return the set point at rest at x, y [m], or at the nearest edge of the workspace."""
    half_x, half_y = settings.half_width, settings.half_depth
    return at_rest(clamp(x, -half_x, half_x)), at_rest(clamp(y, -half_y, half_y))


def _friction(
    settings: PlanarSettings, state: PlanarState, inp: PlanarInput
) -> tuple[float, float]:
    """Return the torques that compensate the friction of shoulder and elbow [Nm]."""
    level, stiffness = settings.joint_friction, settings.joint_friction_stiffness
    return (
        friction_torque(level, stiffness, state.shoulder_friction, inp.shoulder - state.shoulder),
        friction_torque(level, stiffness, state.elbow_friction, inp.elbow - state.elbow),
    )


def _nothing(x: float, y: float, vx: float, vy: float, idle: PlanarState) -> PlanarOutput:
    return PlanarOutput(0.0, 0.0, 0.0, 0.0, x, y, vx, vy, idle.x.position, idle.y.position, False)


def _followed(
    settings: PlanarSettings,
    half: float,
    setpoint: SetPoint,
    position: float,
    velocity: float,
    dt: float,
) -> SetPoint:
    """Return the set point of one axis after one step, within +-half [m]."""
    allowed = Range(-half, half, settings.setpoint_speed, settings.setpoint_acceleration)
    return follow(allowed, setpoint, position, velocity, dt)


def _within(largest: float, x: float, y: float) -> float:
    """Return the factor that scales a vector down to the largest size, direction kept."""
    size = math.hypot(x, y)
    return largest / size if size > largest else 1.0


def _bounded(
    settings: PlanarSettings, force: float, position: float, velocity: float, half: float
) -> float:
    """Return the force along one axis [N] after speed limit and edge of the workspace."""
    force = limit_speed(
        force, velocity, settings.speed_limit, settings.speed_band, settings.speed_damping
    )
    return soft_stop(force, position, -half, half, settings.box_zone, settings.box_stiffness)


def _slewed(
    state: PlanarState, shoulder: float, elbow: float, step: float
) -> tuple[float, float]:
    """Return both torques [Nm] after one step towards these, each by at most `step` [Nm].

    They move on a straight line. Each at its own rate, they would leave the torques that press with
    the force limit on the hand, an ellipse, on the way between two points of it.
    """
    way_s, way_e = abs(shoulder - state.shoulder_torque), abs(elbow - state.elbow_torque)
    part = step / max(way_s, way_e, step)
    return (
        slew(state.shoulder_torque, shoulder, part * way_s),
        slew(state.elbow_torque, elbow, part * way_e),
    )


def _limited_torques(
    settings: PlanarSettings, weight: float, inp: PlanarInput, shoulder: float, elbow: float
) -> tuple[float, float]:
    """Return both torques [Nm] after joint limits and torque limits, scaled by one factor."""
    zone, stiffness = settings.joint_zone, settings.joint_stiffness * weight
    shoulder = soft_stop(
        shoulder, inp.shoulder, settings.shoulder_low, settings.shoulder_high, zone, stiffness
    )
    elbow = soft_stop(elbow, inp.elbow, settings.elbow_low, settings.elbow_high, zone, stiffness)
    # The limit of the angle between the links prevents stretching and folding: opposite torques.
    apart = soft_stop(
        0.0,
        inp.elbow - inp.shoulder,
        settings.between_low,
        settings.between_high,
        zone,
        stiffness,
    )
    shoulder, elbow = shoulder - apart, elbow + apart
    factor = 1.0
    if abs(shoulder) > settings.shoulder_torque:
        factor = settings.shoulder_torque / abs(shoulder)
    if abs(elbow) * factor > settings.elbow_torque:
        factor = settings.elbow_torque / abs(elbow)
    # Rounding may leave the product one floating-point step above the limit.
    return (
        clamp(shoulder * factor, -settings.shoulder_torque, settings.shoulder_torque),
        clamp(elbow * factor, -settings.elbow_torque, settings.elbow_torque),
    )
