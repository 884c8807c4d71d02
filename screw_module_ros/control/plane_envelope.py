# SPDX-License-Identifier: Apache-2.0
"""The envelope of every law of the plane: one tick from both angles to both torques, its bounds.

::

    set point, fades -> law.needs -> law.ask, slot, damper of the guard -> 45 N -> speed limit
      -> edges -> 45 N = what is pressed -> guard -> law.help -> its limits -> speed, edges
      -> torque = J^T force -> joint limits -> torque limits -> force limit of the stops
      -> rate limit -> torques

tau = J^T F. The step multiplies with the arm's Jacobian and never inverts it, so a stretched arm is
no special case. Nothing jumps: the force fades in after enabling, impedance and set point move at
limited rates, each torque changes by at most `torque_rate` dt per step. Only a step to zero is
exempt. What a law asks for, with the edges of the workspace, keeps to the force limit at the hand;
its help has a limit of its own.

All memory is one record that a step changes in place. In the path of a tick some comparisons stand
in place of a function, which costs a call.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from ..filters import envelope
from .arms import FIVE_BAR, Arm
from .gain_guard import GainGuard, damper_force, forget, guard_step, tune_guard
from .limits import (
    DRIVING,
    FARTHEST,
    FASTEST,
    LONGEST_STEP,
    NUMBER,
    STOPPED,
    STRONGEST,
    braking_speed,
    clamp,
    limit_speed,
    slew,
    soft_stop,
)
from .planar import PlanarInput, PlanarOutput
from .planar_settings import MOST_DAMPING, PlanarSettings
from .plane_law import PlaneLaw, PlaneMotion, PlaneSample
from .setpoint import Range, SetPoint, follow, hold_at

OBSERVED = 0.5
"""Share of `chatter_limit` from which an oscillation counts."""
STANDING = 6.0
"""Most help while the handle stands [N]: its friction is 1 N."""
LAW, ARM = 1, 2
"""Who answered with no number: `PlaneState.wrong`."""


@dataclass(slots=True)
class Axis:
    """Memory of x or y: set point, guard."""

    setpoint: SetPoint = field(default_factory=SetPoint)
    guard: GainGuard = field(default_factory=GainGuard)


@dataclass(slots=True)
class PlaneState:
    """Memory of the envelope; `initial_state` makes one.

    law: memory of the law; dt: for which the filters are tuned [s]; stiffness [N/m], damping
    [Ns/m] in use; weight of the force, 0 to 1; driven: largest speed of the handle in the last
    moments [m/s]; helped_x, helped_y: last help within its limits [N]; shoulder, elbow: last
    torques [Nm]; wrong: who answered last with no number, 0 nobody, LAW or ARM.
    """

    law: Any
    dt: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    weight: float = 0.0
    driven: float = 0.0
    x: Axis = field(default_factory=Axis)
    y: Axis = field(default_factory=Axis)
    helped_x: float = 0.0
    helped_y: float = 0.0
    shoulder: float = 0.0
    elbow: float = 0.0
    wrong: int = 0


Step = Callable[[PlanarSettings, Any, Any, PlanarInput, float], PlanarOutput]
"""settings of the plane, what the law's functions get, memory, input, dt [s] -> torques."""


def enveloped(law: PlaneLaw, arm: Arm = FIVE_BAR) -> Step:
    """Return the step of a law on an arm; it takes the memory dt [s] further.

    An input that is not finite or not plausible gives zero output; the caller latches a fault. So
    does an answer of law or arm that is no number, which is `PlaneState.wrong`.
    """
    needs, ask, help_, rest, heeds = law.needs, law.ask, law.help, law.rest, law.heeds
    forward, jacobian, between, singular = arm.forward, arm.jacobian, arm.between, arm.singular

    def step(
        p: PlanarSettings, own: Any, s: PlaneState, inp: PlanarInput, dt: float
    ) -> PlanarOutput:
        s.wrong = 0
        real = (
            abs(inp.shoulder) <= FARTHEST and abs(inp.shoulder_velocity) <= FASTEST
            and abs(inp.elbow) <= FARTHEST and abs(inp.elbow_velocity) <= FASTEST
            and abs(inp.slot_x) <= STRONGEST and abs(inp.slot_y) <= STRONGEST
            and 0.0 <= inp.slot_weight <= 1.0 and dt > 0.0
        )  # fmt: skip  # comparisons with NaN are false
        if not real:
            rest(own, s.law)
            return _rest(p, s, s.x.setpoint.position, s.y.setpoint.position, 0.0, 0.0)
        dt = min(dt, LONGEST_STEP)
        if dt != s.dt:
            s.dt = dt
            tune_guard(s.x.guard, dt)
            tune_guard(s.y.guard, dt)
        x, y = forward(inp.shoulder, inp.elbow, p.arm)
        x_s, x_e, y_s, y_e = jacobian(inp.shoulder, inp.elbow, p.arm)
        apart, with_s, with_e = between(inp.shoulder, inp.elbow, p.arm)
        vx = x_s * inp.shoulder_velocity + x_e * inp.elbow_velocity
        vy = y_s * inp.shoulder_velocity + y_e * inp.elbow_velocity
        size = abs(x) + abs(y) + abs(x_s) + abs(x_e) + abs(y_s) + abs(y_e)
        if not size + abs(apart) + abs(with_s) + abs(with_e) <= NUMBER:  # NaN neither
            rest(own, s.law)
            return _unanswered(p, s, ARM, x, y)
        if not inp.active:
            rest(own, s.law)
            return _rest(p, s, x, y, vx, vy)
        if s.weight == 0.0:
            _hold_at(p, s, x, y)

        known = abs(inp.force_x) <= STRONGEST and abs(inp.force_y) <= STRONGEST
        sample = PlaneSample(
            dt, x, y, vx, vy, inp.force_x if known else 0.0, inp.force_y if known else 0.0, known,
            inp.slot_weight, s.helped_x, s.helped_y,
        )  # fmt: skip
        s.stiffness = slew(s.stiffness, p.stiffness, p.stiffness_rate * dt)
        need = needs(own, s.law, sample, s.stiffness)
        most = math.inf if heeds else MOST_DAMPING
        enough, in_slot = min(float(need.damper), most), min(float(need.in_slot), most)
        s.damping = slew(s.damping, max(p.damping, enough), p.damping_rate * dt)
        s.weight = min(1.0, s.weight + dt / p.fade_time)

        if inp.slot_weight >= 1.0:
            # While a slot guides the hand the set point follows it: leaving it causes no pull.
            _hold_at(p, s, x, y)
        else:
            wide, deep = p.half_width, p.half_depth
            fast = (p.setpoint_speed, p.setpoint_acceleration)
            follow(Range(-wide, wide, *fast), s.x.setpoint, inp.setpoint_x, inp.setpoint_vx, dt)
            follow(Range(-deep, deep, *fast), s.y.setpoint, inp.setpoint_y, inp.setpoint_vy, dt)
        motion = PlaneMotion(
            s.x.setpoint.position, s.y.setpoint.position, s.x.setpoint.velocity,
            s.y.setpoint.velocity, s.stiffness, s.damping,
        )  # fmt: skip

        # What presses on the hand.
        wish_x, wish_y = ask(own, s.law, sample, motion)
        wish_x, wish_y = float(wish_x), float(wish_y)
        finite = enough * enough + in_slot * in_slot + wish_x * wish_x + wish_y * wish_y
        if not finite <= NUMBER * NUMBER:
            return _unanswered(p, s, LAW, x, y)
        lively = need.watched if heeds else s.weight  # weight of what the guard watches over
        left = 1.0 - inp.slot_weight
        asked_x = _pulled(p, s.x.guard, left, wish_x, in_slot, vx, lively) + inp.slot_x
        asked_y = _pulled(p, s.y.guard, left, wish_y, in_slot, vy, lively) + inp.slot_y
        size = math.hypot(asked_x, asked_y)
        kept = p.force_limit / size if size > p.force_limit else 1.0
        # The set point of this package's law keeps its speed; another law may drive up to the edge.
        turns = 0.0 if heeds else 2.0 * max(p.shoulder_torque, p.elbow_torque) / p.torque_rate
        fast_x = braking_speed(p.edge_braking, turns, x, vx, -p.half_width, p.half_width)
        fast_y = braking_speed(p.edge_braking, turns, y, vy, -p.half_depth, p.half_depth)
        fast_x, fast_y = min(p.speed_limit, fast_x), min(p.speed_limit, fast_y)
        force_x = _bounded(p, asked_x * kept, x, vx, p.half_width, fast_x)
        force_y = _bounded(p, asked_y * kept, y, vy, p.half_depth, fast_y)
        size = math.hypot(force_x, force_y)
        again = s.weight * (p.force_limit / size if size > p.force_limit else 1.0)
        force_x, force_y = force_x * again, force_y * again

        # Whether the robot drives what holds the handle; a force that is not known is no error.
        if lively > 0.0:
            felt_x, felt_y = (inp.force_x, inp.force_y) if known else (-force_x, -force_y)
            least, most = OBSERVED * p.chatter_limit, p.chatter_limit
            guard_step(s.x.guard, felt_x, force_x + felt_x, vx, least, most, dt)
            guard_step(s.y.guard, felt_y, force_y + felt_y, vy, least, most, dt)
        else:
            forget(s.x.guard)  # without a gain there is nothing to reduce
            forget(s.y.guard)

        # What helps the hand.
        share_x, share_y = s.x.guard.share, s.y.guard.share
        fed_x, fed_y = help_(own, s.law, sample, motion, (force_x, force_y), (share_x, share_y))
        fed_x = float(fed_x) * (1.0 if heeds else share_x)
        fed_y = float(fed_y) * (1.0 if heeds else share_y)
        if not fed_x * fed_x + fed_y * fed_y <= NUMBER * NUMBER:
            return _unanswered(p, s, LAW, x, y)
        # What stands still against more than friction is an obstacle that the transducer does not
        # feel.
        s.driven = envelope(s.driven, math.hypot(vx, vy), dt, STOPPED)
        opened = STANDING + min(1.0, s.driven / DRIVING) * (p.feedback_limit - STANDING)
        size, most = math.hypot(fed_x, fed_y), min(p.feedback_limit, opened)
        passed = most / size if size > most else 1.0
        s.helped_x, s.helped_y = fed_x * passed, fed_y * passed
        whole_x = force_x + s.weight * _helping(p, s.helped_x, x, vx, p.half_width, fast_x)
        whole_y = force_y + s.weight * _helping(p, s.helped_y, y, vy, p.half_depth, fast_y)

        wanted_s = x_s * whole_x + y_s * whole_y
        wanted_e = x_e * whole_x + y_e * whole_y
        stop = soft_stop(
            0.0, apart, p.between_low, p.between_high, p.joint_zone, p.joint_stiffness * s.weight
        )
        allowed_s, allowed_e = _limited_torques(
            p, s.weight, inp, wanted_s, wanted_e, with_s * stop, with_e * stop
        )
        largest = max(p.force_limit, math.hypot(whole_x, whole_y))
        at_hand = _kept_at_hand(
            singular(p.arm), (x_s, x_e, y_s, y_e), allowed_s, allowed_e, largest
        )
        _slew(s, allowed_s * at_hand, allowed_e * at_hand, p.torque_rate * dt)
        limited = kept < 1.0 or again < s.weight or s.shoulder != wanted_s or s.elbow != wanted_e
        return PlanarOutput(
            s.shoulder, s.elbow, force_x, force_y, x, y, vx, vy, motion.to_x, motion.to_y, limited,
            min(share_x, share_y),
        )  # fmt: skip

    return step


def initial_state(p: PlanarSettings, law: PlaneLaw, own: Any) -> PlaneState:
    """Return the state before the first step: everything at zero."""
    state = PlaneState(law.memory(own))
    law.rest(own, state.law)
    _rest(p, state, 0.0, 0.0, 0.0, 0.0)
    return state


def _rest(
    p: PlanarSettings, s: PlaneState, x: float, y: float, vx: float, vy: float
) -> PlanarOutput:
    """Return no torques, and forget the motion; the handle is at x, y [m] and moves [m/s]."""
    _hold_at(p, s, x, y)
    s.stiffness, s.damping, s.weight = p.stiffness, p.damping, 0.0
    s.shoulder = s.elbow = s.driven = s.helped_x = s.helped_y = 0.0
    forget(s.x.guard)
    forget(s.y.guard)
    to_x, to_y = s.x.setpoint.position, s.y.setpoint.position
    return PlanarOutput(0.0, 0.0, 0.0, 0.0, x, y, vx, vy, to_x, to_y, False, 1.0)


def _unanswered(p: PlanarSettings, s: PlaneState, who: int, x: float, y: float) -> PlanarOutput:
    """Return no torques: the answer of law or arm is no number; the handle is at x, y [m]."""
    s.wrong = who
    return _rest(p, s, x, y, 0.0, 0.0)


def _hold_at(p: PlanarSettings, s: PlaneState, x: float, y: float) -> None:
    """Put the set point to rest at x, y [m], or at the nearest edge of the workspace."""
    hold_at(s.x.setpoint, clamp(x, -p.half_width, p.half_width))
    hold_at(s.y.setpoint, clamp(y, -p.half_depth, p.half_depth))


def _pulled(
    p: PlanarSettings, guard: GainGuard, left: float, wish: float, in_slot: float, velocity: float,
    lively: float,
) -> float:  # fmt: skip
    """Return the force of the law's wish and of the dampers along one axis [N].

    left: share of the wish that no slot replaces, 0 to 1. A slot may have no damper, and a force
    gain leaves no friction that brings a released handle to rest between its walls: in_slot [Ns/m].
    """
    pull = left * wish
    if left < 1.0 and in_slot > 0.0:
        pull -= (1.0 - left) * in_slot * velocity
    return pull - damper_force(guard, velocity, lively, p.chatter_damping)


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
    p: PlanarSettings, weight: float, inp: PlanarInput, shoulder: float, elbow: float,
    apart_s: float, apart_e: float,
) -> tuple[float, float]:  # fmt: skip
    """Return both torques [Nm] after joint limits and torque limits, scaled by one factor.

    apart_s, apart_e: of the stop that prevents stretching and folding.
    """
    stop = (p.joint_zone, p.joint_stiffness * weight)
    shoulder = soft_stop(shoulder, inp.shoulder, p.shoulder_low, p.shoulder_high, *stop)
    elbow = soft_stop(elbow, inp.elbow, p.elbow_low, p.elbow_high, *stop)
    shoulder, elbow = shoulder + apart_s, elbow + apart_e
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
    singular: float, at: tuple[float, float, float, float], shoulder: float, elbow: float,
    largest: float,
) -> float:  # fmt: skip
    """Return the factor that keeps torques [Nm] to the largest force at the hand [N].

    The joints' limits act on torques. Near a stretched arm a small torque is a large force: with
    the links 0.4 rad apart, 8 and 16 Nm of a joint's stop are 160 N at the hand.
    at: Jacobian [m]; the force is J^-T of the torques, here without division by the determinant,
    which counts as `singular` at least [m^2].
    """
    x_s, x_e, y_s, y_e = at
    size = math.hypot(y_e * shoulder - y_s * elbow, x_s * elbow - x_e * shoulder)
    allowed = largest * max(abs(x_s * y_e - x_e * y_s), singular)
    return allowed / size if size > allowed else 1.0


def _slew(s: PlaneState, to_s: float, to_e: float, step: float) -> None:
    """Take both torques one step towards these [Nm], each by at most `step` [Nm].

    They move on a straight line: each at its own rate, they would leave the ellipse of torques that
    press with the force limit on the hand, on the way between two points of it.
    """
    way_s, way_e = abs(to_s - s.shoulder), abs(to_e - s.elbow)
    part = step / max(way_s, way_e, step)
    s.shoulder = slew(s.shoulder, to_s, part * way_s)
    s.elbow = slew(s.elbow, to_e, part * way_e)
