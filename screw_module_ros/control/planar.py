# SPDX-License-Identifier: Apache-2.0
"""The planar law: an impedance at the handle through the Jacobian (MIT-MANUS, thesis 3.3).

::

    set point -> spring and damper in x and y -> + carried mass -> speed limit -> workspace
              -> force limit -> torque = J^T force -> + joint friction -> joint limits
              -> torque limits -> force limit at the hand -> rate limit -> torques

F = K (x_d - x) + B (v_d - v), eq 3.3; tau = J^T F with absolute joint angles. The law multiplies
with the Jacobian and never inverts it, so a stretched arm is no special case. Nothing jumps: the
force fades in after enabling, impedance and set point move at limited rates, each torque changes by
at most `torque_rate` dt per step, 0.6 Nm at 500 Hz by default. Only a step to zero is exempt.

The thesis leaves friction and mass as they are: 57 to 113 gram-force and the module's 12 lb on an
arm of 4/3 kg at most (2.2.4, appendix D). Two parts, off by default, compensate some of that. The
friction of each joint is fed forward by its angle. A force of `carried_mass` times the estimated
acceleration carries mass; at the tip it weighs the same in every direction, without inertias of the
arm. The estimate lags, and on a stiff, badly damped load no damper of the law makes up for that:
mass is carried only in motion, and a guard takes it away when the force for it is rapid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

from ..filters import Lowpass, clear, derivative, envelope, tune, tune_highpass
from ..geometry import forward, jacobian
from .friction import hysteresis
from .guard import Chatter, chatter_step, forget_chatter
from .limits import LONGEST_STEP, clamp, is_real, limit_speed, slew, soft_stop
from .planar_settings import CARRIED_HZ, PlanarSettings, least_damping
from .setpoint import Range, SetPoint, follow, hold_at

MOVING = 0.03  # [m/s] largest recent speed along an axis from which all of the mass is carried
CHATTER_HZ = 6.0  # of the force that carries the mass; of 3 Hz 20 % pass
LARGEST = 20.0  # [N] that carry the mass, along each axis
SMALLEST_FRICTION = 1e-3  # [Nm] keeps the angle over which it reverses finite
# Sine of the angle between the links up to which the arm counts as stretched or folded: the torque
# that leads out of there does not vanish.
SINGULAR = 0.02


class PlanarInput(NamedTuple):
    """Inputs of one step.

    shoulder, elbow: absolute joint angles [rad]; shoulder_velocity, elbow_velocity [rad/s];
    setpoint_x, setpoint_y [m] from the workspace centre, NaN = leave that axis alone;
    setpoint_vx, setpoint_vy [m/s]; active: False holds the torques at zero and the set point at the
    measured position; slot_x, slot_y: force of a slot [N]; slot_weight: 0 to 1, of spring and
    damper that it replaces.
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

    shoulder_torque, elbow_torque [Nm]; force_x, force_y: on the handle, before the joints' limits
    [N]; x, y [m], vx, vy [m/s]: handle; desired_x, desired_y [m]: set point; saturated: by a limit.
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


@dataclass(slots=True)
class Axis:
    """Memory of x or y. For the carried mass: low pass, chatter, largest recent velocity [m/s]."""

    setpoint: SetPoint = field(default_factory=SetPoint)
    speed: Lowpass = field(default_factory=Lowpass)
    fastest: float = 0.0
    chatter: Chatter = field(default_factory=Chatter)


@dataclass(slots=True)
class Joint:
    """Memory of shoulder or elbow: last angle [rad], modelled friction and last command [Nm]."""

    angle: float = 0.0
    friction: float = 0.0
    torque: float = 0.0


@dataclass(slots=True)
class PlanarState:
    """Memory of the law; `initial_state` makes one. dt: for which the filters are tuned [s];
    stiffness [N/m], damping [Ns/m] in use; weight of the force, 0 to 1."""

    dt: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    weight: float = 0.0
    x: Axis = field(default_factory=Axis)
    y: Axis = field(default_factory=Axis)
    shoulder: Joint = field(default_factory=Joint)
    elbow: Joint = field(default_factory=Joint)


def initial_state(p: PlanarSettings) -> PlanarState:
    """Return the state before the first step: everything at zero."""
    state = PlanarState()
    _rest(p, state, (0.0, 0.0, 0.0, 0.0), 0.0, 0.0)
    return state


def planar_step(p: PlanarSettings, s: PlanarState, inp: PlanarInput, dt: float) -> PlanarOutput:
    """Return the torques, and take the state dt [s] further.

    An input that is not finite or not plausible gives zero output; the caller latches a fault.
    """
    if not _usable(inp, dt):
        x, y = s.x.setpoint.position, s.y.setpoint.position
        return _rest(p, s, (x, y, 0.0, 0.0), 0.0, 0.0)
    dt = min(dt, LONGEST_STEP)
    if dt != s.dt:
        _tune(s, dt)
    x, y = forward(inp.shoulder, inp.elbow, p.arm)
    x_s, x_e, y_s, y_e = jacobian(inp.shoulder, inp.elbow, p.arm)
    vx = x_s * inp.shoulder_velocity + x_e * inp.elbow_velocity
    vy = y_s * inp.shoulder_velocity + y_e * inp.elbow_velocity
    if not inp.active:
        return _rest(p, s, (x, y, vx, vy), inp.shoulder, inp.elbow)
    if s.weight == 0.0:
        _place(p, s, x, y, inp.shoulder, inp.elbow)

    s.stiffness = slew(s.stiffness, p.stiffness, p.stiffness_rate * dt)
    enough = max(p.damping, least_damping(p, s.stiffness))
    s.damping = slew(s.damping, enough, p.damping_rate * dt)
    s.weight = min(1.0, s.weight + dt / p.fade_time)

    if inp.slot_weight >= 1.0:
        # While a slot guides the hand the set point follows it: leaving the slot causes no pull.
        _hold_at(p, s, x, y)
    else:
        follow(_range(p, p.half_width), s.x.setpoint, inp.setpoint_x, inp.setpoint_vx, dt)
        follow(_range(p, p.half_depth), s.y.setpoint, inp.setpoint_y, inp.setpoint_vy, dt)
    left = 1.0 - inp.slot_weight
    asked_x = left * _spring(s, s.x.setpoint, x, vx) + inp.slot_x + carried_force(p, s.x, vx, dt)
    asked_y = left * _spring(s, s.y.setpoint, y, vy) + inp.slot_y + carried_force(p, s.y, vy, dt)
    kept = _within(p.force_limit, asked_x, asked_y)
    force_x = _bounded(p, asked_x * kept, x, vx, p.half_width)
    force_y = _bounded(p, asked_y * kept, y, vy, p.half_depth)
    again = s.weight * _within(p.force_limit, force_x, force_y)
    force_x, force_y = force_x * again, force_y * again

    wanted_s = x_s * force_x + y_s * force_y
    wanted_e = x_e * force_x + y_e * force_y
    wanted_s += s.weight * joint_friction(p, s.shoulder, inp.shoulder)
    wanted_e += s.weight * joint_friction(p, s.elbow, inp.elbow)
    allowed_s, allowed_e = _limited_torques(p, s.weight, inp, wanted_s, wanted_e)
    at_hand = _kept_at_hand(p, (x_s, x_e, y_s, y_e), allowed_s, allowed_e)
    _slew(s.shoulder, s.elbow, allowed_s * at_hand, allowed_e * at_hand, p.torque_rate * dt)
    made_s, made_e = s.shoulder.torque, s.elbow.torque
    to_x, to_y = s.x.setpoint.position, s.y.setpoint.position
    limited = kept < 1.0 or again < s.weight or made_s != wanted_s or made_e != wanted_e
    return PlanarOutput(made_s, made_e, force_x, force_y, x, y, vx, vy, to_x, to_y, limited)


def _usable(inp: PlanarInput, dt: float) -> bool:
    """Return whether the inputs can be real; comparisons with NaN are false."""
    shoulder = is_real(inp.shoulder, inp.shoulder_velocity, inp.slot_x)
    elbow = is_real(inp.elbow, inp.elbow_velocity, inp.slot_y)
    return shoulder and elbow and 0.0 <= inp.slot_weight <= 1.0 and dt > 0.0


def _rest(
    p: PlanarSettings, s: PlanarState, hand: tuple[float, float, float, float],
    shoulder: float, elbow: float,
) -> PlanarOutput:  # fmt: skip
    """Return no torques; hand: x, y [m], vx, vy [m/s]; joints at their angles [rad]."""
    x, y, vx, vy = hand
    _place(p, s, x, y, shoulder, elbow)
    s.stiffness, s.damping, s.weight = p.stiffness, p.damping, 0.0
    s.shoulder.torque, s.elbow.torque = 0.0, 0.0
    to_x, to_y = s.x.setpoint.position, s.y.setpoint.position
    return PlanarOutput(0.0, 0.0, 0.0, 0.0, x, y, vx, vy, to_x, to_y, False)


def _place(
    p: PlanarSettings, s: PlanarState, x: float, y: float, shoulder: float, elbow: float
) -> None:
    """Forget the motion: the handle is at x, y [m], the joints at their angles [rad]."""
    _hold_at(p, s, x, y)
    for axis in (s.x, s.y):
        clear(axis.speed)
        axis.fastest = 0.0
        forget_chatter(axis.chatter)
    s.shoulder.angle, s.shoulder.friction = shoulder, 0.0
    s.elbow.angle, s.elbow.friction = elbow, 0.0


def _hold_at(p: PlanarSettings, s: PlanarState, x: float, y: float) -> None:
    """Put the set point to rest at x, y [m], or at the nearest edge of the workspace."""
    hold_at(s.x.setpoint, clamp(x, -p.half_width, p.half_width))
    hold_at(s.y.setpoint, clamp(y, -p.half_depth, p.half_depth))


def _tune(s: PlanarState, dt: float) -> None:
    """Prepare all filters for a sample time dt [s]."""
    s.dt = dt
    for axis in (s.x, s.y):
        tune(axis.speed, CARRIED_HZ, dt)
        tune_highpass(axis.chatter.fast, CHATTER_HZ, dt)


def _range(p: PlanarSettings, half: float) -> Range:
    """Return the limits of the set point along one axis, within +-half [m]."""
    return Range(-half, half, p.setpoint_speed, p.setpoint_acceleration)


def _spring(s: PlanarState, to: SetPoint, position: float, velocity: float) -> float:
    """Return the force of spring and damper along one axis [N]."""
    return s.stiffness * (to.position - position) + s.damping * (to.velocity - velocity)


def carried_force(p: PlanarSettings, axis: Axis, velocity: float, dt: float) -> float:
    """Return the force that carries a mass along one axis [N]; velocity: of the handle [m/s]."""
    acceleration = derivative(axis.speed, velocity)
    axis.fastest = envelope(axis.fastest, axis.speed.y, dt)
    force = min(1.0, axis.fastest / MOVING) * p.carried_mass * acceleration
    share = chatter_step(axis.chatter, force, p.carried_limit, dt)
    return share * clamp(force, -LARGEST, LARGEST)


def joint_friction(p: PlanarSettings, joint: Joint, angle: float) -> float:
    """Return the torque that compensates a joint's friction [Nm], positive along the motion."""
    level, turned = p.joint_friction, angle - joint.angle
    joint.angle = angle
    if level < SMALLEST_FRICTION:
        joint.friction = 0.0
    else:
        reached = hysteresis(joint.friction, level, p.joint_friction_stiffness, turned)
        joint.friction = clamp(reached, -level, level)
    return joint.friction


def _within(largest: float, x: float, y: float) -> float:
    """Return the factor that scales a vector down to the largest size, direction kept."""
    size = math.hypot(x, y)
    return largest / size if size > largest else 1.0


def _bounded(p: PlanarSettings, force: float, at: float, velocity: float, half: float) -> float:
    """Return the force along one axis [N] after speed limit and edge of the workspace; at [m]."""
    force = limit_speed(force, velocity, p.speed_limit, p.speed_band, p.speed_damping)
    return soft_stop(force, at, -half, half, p.box_zone, p.box_stiffness)


def _limited_torques(
    p: PlanarSettings, weight: float, inp: PlanarInput, shoulder: float, elbow: float
) -> tuple[float, float]:
    """Return both torques [Nm] after joint limits and torque limits, scaled by one factor."""
    stop = (p.joint_zone, p.joint_stiffness * weight)
    shoulder = soft_stop(shoulder, inp.shoulder, p.shoulder_low, p.shoulder_high, *stop)
    elbow = soft_stop(elbow, inp.elbow, p.elbow_low, p.elbow_high, *stop)
    # The limit of the angle between the links prevents stretching and folding: opposite torques.
    between = inp.elbow - inp.shoulder
    apart = soft_stop(0.0, between, p.between_low, p.between_high, *stop)
    shoulder, elbow = shoulder - apart, elbow + apart
    factor = 1.0
    if abs(shoulder) > p.shoulder_torque:
        factor = p.shoulder_torque / abs(shoulder)
    if abs(elbow) * factor > p.elbow_torque:
        factor = p.elbow_torque / abs(elbow)
    # Rounding may leave the product one floating-point step above the limit.
    return (
        clamp(shoulder * factor, -p.shoulder_torque, p.shoulder_torque),
        clamp(elbow * factor, -p.elbow_torque, p.elbow_torque),
    )


def _kept_at_hand(
    p: PlanarSettings, at: tuple[float, float, float, float], shoulder: float, elbow: float
) -> float:
    """Return the factor that keeps torques [Nm] to the force limit at the hand.

    The joints' limits act on torques. Near a stretched arm a small torque is a large force: 1 cm
    behind the far corners of the workspace, 8 and 16 Nm of a joint's stop are 160 N at the hand.
    at: Jacobian [m]; the force is J^-T of the torques, here without division by the determinant.
    """
    x_s, x_e, y_s, y_e = at
    size = math.hypot(y_e * shoulder - y_s * elbow, x_s * elbow - x_e * shoulder)
    singular = SINGULAR * p.arm.upper_arm * p.arm.forearm
    allowed = p.force_limit * max(abs(x_s * y_e - x_e * y_s), singular)
    return allowed / size if size > allowed else 1.0


def _slew(shoulder: Joint, elbow: Joint, to_s: float, to_e: float, step: float) -> None:
    """Take both torques one step towards these [Nm], each by at most `step` [Nm].

    They move on a straight line: each at its own rate, they would leave the ellipse of torques that
    press with the force limit on the hand, on the way between two points of it.
    """
    way_s, way_e = abs(to_s - shoulder.torque), abs(to_e - elbow.torque)
    part = step / max(way_s, way_e, step)
    shoulder.torque = slew(shoulder.torque, to_s, part * way_s)
    elbow.torque = slew(elbow.torque, to_e, part * way_e)
