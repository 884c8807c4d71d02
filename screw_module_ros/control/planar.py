# SPDX-License-Identifier: Apache-2.0
"""The planar law: an impedance at the handle through the Jacobian (MIT-MANUS, thesis 3.3).

::

    set point -> spring, damper, slot -> 45 N -> speed limit -> edges -> 45 N = desired force Fpd
              -> + k w / (s + w) (Fpd + F) -> torque = J^T force -> joint limits -> torque limits
              -> force limit of the stops -> rate limit -> torques

Fpd = K (x_d - x) + B (v_d - v), eq 3.3; tau = J^T F with absolute joint angles. The law multiplies
with the Jacobian and never inverts it, so a stretched arm is no special case. Nothing jumps: the
force fades in after enabling, impedance, gain and set point move at limited rates, each torque
changes by at most `torque_rate` dt per step. Only a step to zero is exempt.

The thesis leaves friction and mass as they are: 57 to 113 gram-force and the module's 12 lb on an
arm of 4/3 kg at most (2.2.4, appendix D). What the hand feels beyond -Fpd is due to them, so a
force gain k on Fpd + F, F the patient's force on the robot, divides both by 1 + k, as in the
vertical law (eqs 6.5 to 6.8), and with the same guard, one along x and one along y. Fpd, with the
edges of the workspace, keeps to the force limit at the hand; the feedback has its own limit.
Without a force sample the gain fades, and the impedance is left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

from ..filters import envelope
from ..geometry import forward, jacobian
from .guard import OBSERVED, Guard, damper_force, forget, guard_step, leaky_gain, tune_guard
from .limits import LONGEST_STEP, STRONGEST, clamp, is_real, limit_speed, slew, soft_stop
from .planar_settings import PlanarSettings, least_damping
from .setpoint import Range, SetPoint, follow, hold_at

# Lower than in the vertical law: on a wall of 1e6 N/m the plane oscillates at 60 Hz.
CHATTER_HZ = 40.0
RETURN = 3.0  # [s] in which the gain comes back there, longer too: the wall stays
STANDING = 6.0  # [N] of feedback at most while the handle stands: its friction is 1 N
DRIVING = 0.05  # [m/s] largest recent speed from which `feedback_limit` alone bounds it
STOPPED = 0.2  # [s] time constant with which a handle that moved counts as one that stands
GUIDED = 100.0  # [N/m] of a usual slot, whose spring is not in the input
# Sine of the angle between the links up to which the arm counts as stretched or folded: the torque
# that leads out of there does not vanish.
SINGULAR = 0.02


class PlanarInput(NamedTuple):
    """Inputs of one step.

    shoulder, elbow: absolute joint angles [rad]; shoulder_velocity, elbow_velocity [rad/s];
    setpoint_x, setpoint_y [m] from the workspace centre, NaN = leave that axis alone;
    setpoint_vx, setpoint_vy [m/s]; active: False holds the torques at zero and the set point at the
    measured position; slot_x, slot_y: force of a slot [N]; slot_weight: 0 to 1, of spring and
    damper that it replaces; force_x, force_y: of the patient on the robot [N], NaN = not known.
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
    force_x: float = math.nan
    force_y: float = math.nan


class PlanarOutput(NamedTuple):
    """Torques and the quantities behind them.

    shoulder_torque, elbow_torque [Nm]; force_x, force_y: desired on the hand, without feedback and
    the joints' limits [N]; x, y [m], vx, vy [m/s]: handle; desired_x, desired_y [m]: set point;
    saturated: by a limit; share: of the force gain left by the guard, 0 to 1.
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
    share: float


@dataclass(slots=True)
class Axis:
    """Memory of x or y: set point, guard; error Fpd + F of the last step, feedback [N]."""

    setpoint: SetPoint = field(default_factory=SetPoint)
    guard: Guard = field(default_factory=Guard)
    error: float = 0.0
    fed: float = 0.0


@dataclass(slots=True)
class PlanarState:
    """Memory of the law; `initial_state` makes one. dt: for which the filters are tuned [s];
    stiffness [N/m], damping [Ns/m], force gain in use; weight of the force, 0 to 1; driven:
    largest speed of the handle in the last moments [m/s]; shoulder, elbow: last torques [Nm]."""

    dt: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    gain: float = 0.0
    weight: float = 0.0
    driven: float = 0.0
    x: Axis = field(default_factory=Axis)
    y: Axis = field(default_factory=Axis)
    shoulder: float = 0.0
    elbow: float = 0.0


def initial_state(p: PlanarSettings) -> PlanarState:
    """Return the state before the first step: everything at zero."""
    state = PlanarState()
    _rest(p, state, 0.0, 0.0, 0.0, 0.0)
    return state


def planar_step(p: PlanarSettings, s: PlanarState, inp: PlanarInput, dt: float) -> PlanarOutput:
    """Return the torques, and take the state dt [s] further.

    An input that is not finite or not plausible gives zero output; the caller latches a fault.
    """
    if not _usable(inp, dt):
        return _rest(p, s, s.x.setpoint.position, s.y.setpoint.position, 0.0, 0.0)
    dt = min(dt, LONGEST_STEP)
    if dt != s.dt:
        s.dt = dt
        tune_guard(s.x.guard, dt, CHATTER_HZ)
        tune_guard(s.y.guard, dt, CHATTER_HZ)
    x, y = forward(inp.shoulder, inp.elbow, p.arm)
    x_s, x_e, y_s, y_e = jacobian(inp.shoulder, inp.elbow, p.arm)
    vx = x_s * inp.shoulder_velocity + x_e * inp.elbow_velocity
    vy = y_s * inp.shoulder_velocity + y_e * inp.elbow_velocity
    if not inp.active:
        return _rest(p, s, x, y, vx, vy)
    if s.weight == 0.0:
        _hold_at(p, s, x, y)

    known = abs(inp.force_x) <= STRONGEST and abs(inp.force_y) <= STRONGEST
    s.stiffness = slew(s.stiffness, p.stiffness, p.stiffness_rate * dt)
    s.gain = slew(s.gain, p.force_gain if known else 0.0, p.gain_rate * dt)
    enough = max(p.damping, least_damping(p, s.stiffness, s.gain))
    s.damping = slew(s.damping, enough, p.damping_rate * dt)
    s.weight = min(1.0, s.weight + dt / p.fade_time)

    if inp.slot_weight >= 1.0:
        # While a slot guides the hand the set point follows it: leaving the slot causes no pull.
        _hold_at(p, s, x, y)
    else:
        wide, deep, fast = p.half_width, p.half_depth, (p.setpoint_speed, p.setpoint_acceleration)
        follow(Range(-wide, wide, *fast), s.x.setpoint, inp.setpoint_x, inp.setpoint_vx, dt)
        follow(Range(-deep, deep, *fast), s.y.setpoint, inp.setpoint_y, inp.setpoint_vy, dt)
    left = 1.0 - inp.slot_weight
    asked_x = _asked(p, s, s.x, left, x, vx) + inp.slot_x
    asked_y = _asked(p, s, s.y, left, y, vy) + inp.slot_y
    kept = _within(p.force_limit, asked_x, asked_y)
    fast_x, fast_y = _allowed(p, x, vx, p.half_width), _allowed(p, y, vy, p.half_depth)
    force_x = _bounded(p, asked_x * kept, x, vx, p.half_width, fast_x)
    force_y = _bounded(p, asked_y * kept, y, vy, p.half_depth, fast_y)
    again = s.weight * _within(p.force_limit, force_x, force_y)
    force_x, force_y = force_x * again, force_y * again

    _feed_back(p, s, s.x, force_x, inp.force_x if known else -force_x, vx, dt)
    _feed_back(p, s, s.y, force_y, inp.force_y if known else -force_y, vy, dt)
    # What stands still against more than friction is an obstacle that the transducer does not feel.
    s.driven = envelope(s.driven, math.hypot(vx, vy), dt, STOPPED)
    opened = STANDING + min(1.0, s.driven / DRIVING) * (p.feedback_limit - STANDING)
    most = _within(min(p.feedback_limit, opened), s.x.fed, s.y.fed)
    s.x.fed, s.y.fed = s.x.fed * most, s.y.fed * most
    whole_x = force_x + s.weight * _helping(p, s.x.fed, x, vx, p.half_width, fast_x)
    whole_y = force_y + s.weight * _helping(p, s.y.fed, y, vy, p.half_depth, fast_y)

    wanted_s = x_s * whole_x + y_s * whole_y
    wanted_e = x_e * whole_x + y_e * whole_y
    allowed_s, allowed_e = _limited_torques(p, s.weight, inp, wanted_s, wanted_e)
    largest = max(p.force_limit, math.hypot(whole_x, whole_y))
    at_hand = _kept_at_hand(p, (x_s, x_e, y_s, y_e), allowed_s, allowed_e, largest)
    _slew(s, allowed_s * at_hand, allowed_e * at_hand, p.torque_rate * dt)
    to_x, to_y = s.x.setpoint.position, s.y.setpoint.position
    limited = kept < 1.0 or again < s.weight or s.shoulder != wanted_s or s.elbow != wanted_e
    share = min(s.x.guard.share, s.y.guard.share)
    return PlanarOutput(
        s.shoulder, s.elbow, force_x, force_y, x, y, vx, vy, to_x, to_y, limited, share
    )


def _usable(inp: PlanarInput, dt: float) -> bool:
    """Return whether the inputs can be real; comparisons with NaN are false."""
    shoulder = is_real(inp.shoulder, inp.shoulder_velocity, inp.slot_x)
    elbow = is_real(inp.elbow, inp.elbow_velocity, inp.slot_y)
    return shoulder and elbow and 0.0 <= inp.slot_weight <= 1.0 and dt > 0.0


def _rest(
    p: PlanarSettings, s: PlanarState, x: float, y: float, vx: float, vy: float
) -> PlanarOutput:
    """Return no torques, and forget the motion; the handle is at x, y [m] and moves [m/s]."""
    _hold_at(p, s, x, y)
    s.stiffness, s.damping, s.gain, s.weight = p.stiffness, p.damping, 0.0, 0.0
    s.shoulder = s.elbow = s.driven = 0.0
    for axis in (s.x, s.y):
        forget(axis.guard)
        axis.error = axis.fed = 0.0
    to_x, to_y = s.x.setpoint.position, s.y.setpoint.position
    return PlanarOutput(0.0, 0.0, 0.0, 0.0, x, y, vx, vy, to_x, to_y, False, 1.0)


def _hold_at(p: PlanarSettings, s: PlanarState, x: float, y: float) -> None:
    """Put the set point to rest at x, y [m], or at the nearest edge of the workspace."""
    hold_at(s.x.setpoint, clamp(x, -p.half_width, p.half_width))
    hold_at(s.y.setpoint, clamp(y, -p.half_depth, p.half_depth))


def _asked(
    p: PlanarSettings, s: PlanarState, axis: Axis, left: float, position: float, velocity: float
) -> float:
    """Return the force of spring, damper and the guard's damper along one axis [N].

    left: share of spring and damper that no slot replaces, 0 to 1. A slot may have no damper, and
    the force gain leaves no friction that brings a released handle to rest between its walls.
    """
    to = axis.setpoint
    pull = left * (s.stiffness * (to.position - position) + s.damping * (to.velocity - velocity))
    if left < 1.0 and s.gain > 0.0:
        pull -= (1.0 - left) * least_damping(p, max(s.stiffness, GUIDED), s.gain) * velocity
    # Chatter is what no velocity shows: no damper meets it.
    weight = min(1.0, s.gain) * axis.guard.chatter.share
    return pull - damper_force(axis.guard.passivity, velocity, weight, p.chatter_damping)


def _feed_back(
    p: PlanarSettings, s: PlanarState, axis: Axis, desired: float, force: float, velocity: float,
    dt: float,
) -> None:  # fmt: skip
    """Take guard and force feedback of an axis one step further (eqs 6.5 to 6.8).

    desired: Fpd; force: of the patient [N], -Fpd, which is no error, where it is not known;
    velocity [m/s].
    """
    error = desired + force
    if s.gain > 0.0:
        least = OBSERVED * p.chatter_limit
        guard_step(axis.guard, force, error, velocity, least, p.chatter_limit, dt, RETURN)
    else:
        forget(axis.guard)  # without a gain there is nothing to reduce
    mean = 0.5 * (error + axis.error)
    axis.fed = leaky_gain(axis.fed, mean, axis.guard.share, s.gain, p.force_cutoff, dt)
    axis.error = error


def _within(largest: float, x: float, y: float) -> float:
    """Return the factor that scales a vector down to the largest size, direction kept."""
    size = math.hypot(x, y)
    return largest / size if size > largest else 1.0


def _allowed(p: PlanarSettings, at: float, velocity: float, half: float) -> float:
    """Return the speed limit along one axis [m/s] at a place [m].

    Towards an edge it falls with the way left d, to v^2 = 2 a d.
    """
    left = max(0.0, half - at if velocity > 0.0 else half + at)
    return min(p.speed_limit, math.sqrt(2.0 * p.edge_braking * left))


def _bounded(
    p: PlanarSettings, force: float, at: float, velocity: float, half: float, allowed: float
) -> float:
    """Return the force along one axis [N] after speed limit, allowed [m/s], and edge; at [m]."""
    force = limit_speed(force, velocity, allowed, p.speed_band, p.speed_damping)
    return soft_stop(force, at, -half, half, p.box_zone, p.box_stiffness)


def _helping(
    p: PlanarSettings, fed: float, at: float, velocity: float, half: float, allowed: float
) -> float:
    """Return the feedback along one axis [N] that does not help the hand too fast, or outward."""
    if fed * velocity > 0.0:
        fed *= min(1.0, max(0.0, 1.0 - (abs(velocity) - allowed) / p.speed_band))
    return soft_stop(fed, at, -half, half, p.box_zone, 0.0)


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
        min(max(shoulder * factor, -p.shoulder_torque), p.shoulder_torque),
        min(max(elbow * factor, -p.elbow_torque), p.elbow_torque),
    )


def _kept_at_hand(
    p: PlanarSettings, at: tuple[float, float, float, float], shoulder: float, elbow: float,
    largest: float,
) -> float:  # fmt: skip
    """Return the factor that keeps torques [Nm] to the largest force at the hand [N].

    The joints' limits act on torques. Near a stretched arm a small torque is a large force: 1 cm
    behind the far corners of the workspace, 8 and 16 Nm of a joint's stop are 160 N at the hand.
    at: Jacobian [m]; the force is J^-T of the torques, here without division by the determinant.
    """
    x_s, x_e, y_s, y_e = at
    size = math.hypot(y_e * shoulder - y_s * elbow, x_s * elbow - x_e * shoulder)
    singular = SINGULAR * p.arm.upper_arm * p.arm.forearm
    allowed = largest * max(abs(x_s * y_e - x_e * y_s), singular)
    return allowed / size if size > allowed else 1.0


def _slew(s: PlanarState, to_s: float, to_e: float, step: float) -> None:
    """Take both torques one step towards these [Nm], each by at most `step` [Nm].

    They move on a straight line: each at its own rate, they would leave the ellipse of torques that
    press with the force limit on the hand, on the way between two points of it.
    """
    way_s, way_e = abs(to_s - s.shoulder), abs(to_e - s.elbow)
    part = step / max(way_s, way_e, step)
    s.shoulder = slew(s.shoulder, to_s, part * way_s)
    s.elbow = slew(s.elbow, to_e, part * way_e)
