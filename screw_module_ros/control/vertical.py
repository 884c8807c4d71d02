# SPDX-License-Identifier: Apache-2.0
"""The vertical law: from one encoder sample and one handle force to one force command.

::

    set point -> spring and dampers -> 65 N up, 45 N down -> + weight + friction + feedback
              -> speed limit -> force limits -> soft stops -> rate limit -> command

The hand's force is that of spring and dampers, Fpd, within the limits of the endpoint (thesis
2.1.1). The modes compensate weight, friction and inertia (eqs 6.1 to 6.8, figs 6-6 and 6-11;
`docs/control.md` draws each). COMBINED is the plain sum: the friction model removes the predicted
part from Fpd + Fp, so the feedback acts on the remainder only (6.4.4). The total command also
carries the weight and overcomes friction; its limits are 95 N and 75 N.

Nothing jumps. Each part fades in and out over `fade_time` with its own weight. Stiffness, damping,
force gain, gravity and set point change at limited rates. The command changes by at most
`force_rate` dt per step, 2 N at 1 kHz by default, also at a change of mode. Enabling is a change
from OFF, with the set point at the measured position. Only a step to zero is exempt.

All memory is one record that a step changes in place. `vertical_step` is one tick in its order.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from ..filters import Lowpass, clear, derivative, envelope, smoothed, tune
from .friction import FrictionModel, Presliding, compare_step, model_share, presliding_step
from .guard import OBSERVED, Guard, damper_force, forget, guard_step, leaky_gain, tune_guard
from .limits import (
    DRIVING,
    LONGEST_STEP,
    STOPPED,
    STRONGEST,
    braking_speed,
    clamp,
    is_real,
    limit_speed,
    slew,
    soft_stop,
)
from .modes import uses_feedback, uses_friction, uses_impedance, uses_observer
from .observer import Observer, observe, remember, settle
from .setpoint import Range, SetPoint, follow, hold_at
from .vertical_settings import CARRIED_HZ, VerticalSettings, least_damping

HELD = 0.8  # [N] largest recent force from which a hand holds the handle
FIRM = 1.0  # [N] of the hand from which the carried mass is in with all of its share
NOTHING_HOLDS = 200.0  # [N] more than all parts together
LOADED = 0.2  # of the force on the hand: more friction of a screw under load, at most


class VerticalInput(NamedTuple):
    """Inputs of one step, up positive.

    mode: constant of `modes`; position [m], velocity [m/s] of the nut; force: patient on robot,
    tared [N]; setpoint_position [m], NaN = none; setpoint_velocity
    [m/s]; active: False holds the command at zero and the set point at the measured position;
    slot_force: of a slot (`slot`) [N]; slot_weight: 0 to 1, of spring and dampers that it replaces.
    """

    mode: int
    position: float
    velocity: float
    force: float
    setpoint_position: float
    setpoint_velocity: float
    active: bool
    slot_force: float = 0.0
    slot_weight: float = 0.0


class VerticalOutput(NamedTuple):
    """Command and its parts.

    force: total after limits [N]; impedance, gravity, friction, feedback, carried (for the mass):
    its parts before the limits on the total [N]; saturated: a limit acted; desired_position [m],
    desired_velocity [m/s]: set point in use; share: of the force gains left by the guard, 0 to 1.
    """

    force: float
    impedance: float
    gravity: float
    friction: float
    feedback: float
    carried: float
    saturated: bool
    desired_position: float
    desired_velocity: float
    share: float = 1.0


@dataclass(slots=True)
class VerticalState:
    """Memory of the law; `initial_state` makes one.

    dt: for which the filters are tuned [s]; placed: `position`, of the last sample [m], is known;
    force: last command [N]; stiffness [N/m], damping [Ns/m], gain Kf, gravity [N]: in use, while
    they follow their settings; weights of the parts while they fade, 0 to 1: base (spring, dampers,
    gravity), friction, feedback, observing; fed: feedback of OBSERVER [N]; held: largest recent
    handle force [N], driven: largest speed of the nut in the last moments [m/s]; low passes of
    handle force, force error and estimated speed.
    """

    dt: float = 0.0
    placed: bool = False
    position: float = 0.0
    force: float = 0.0
    setpoint: SetPoint = field(default_factory=SetPoint)
    stiffness: float = 0.0
    damping: float = 0.0
    gain: float = 0.0
    gravity: float = 0.0
    base: float = 0.0
    friction: float = 0.0
    feedback: float = 0.0
    observing: float = 0.0
    presliding: Presliding = field(default_factory=Presliding)
    observer: Observer = field(default_factory=Observer)
    guard: Guard = field(default_factory=Guard)
    fed: float = 0.0
    held: float = 0.0
    driven: float = 0.0
    handle: Lowpass = field(default_factory=Lowpass)
    error: Lowpass = field(default_factory=Lowpass)
    speed: Lowpass = field(default_factory=Lowpass)


def initial_state(p: VerticalSettings) -> VerticalState:
    """Return the state before the first step: everything at zero."""
    state = VerticalState()
    _rest(p, state, 0.0)
    state.placed = False
    return state


def vertical_step(
    p: VerticalSettings, model: FrictionModel, s: VerticalState, inp: VerticalInput, dt: float
) -> VerticalOutput:
    """Return the command, and take the state dt [s] further.

    An input that is not finite or not plausible gives zero output; the caller latches a fault.
    """
    if not _usable(inp, dt):
        nothing = _rest(p, s, s.setpoint.position)
        s.placed = False  # the position of the nut is unknown: the next good sample is the first
        return nothing
    dt = min(dt, LONGEST_STEP)
    if dt != s.dt or p.force_cutoff != s.handle.cutoff or p.observer_cutoff != s.error.cutoff:
        _tune(p, s, dt)
    handle = smoothed(s.handle, inp.force)
    if not inp.active:
        return _rest(p, s, inp.position)
    if not s.placed:
        s.position = inp.position
        settle(s.observer, inp.position)
    _follow(p, s, inp, dt)
    _fade(p, s, inp.mode, dt)

    # Weight, and friction by the model and by the observer.
    gravity = s.base * s.gravity
    friction = _fed_forward(p, model, s, inp)
    observe(p, s.observer, inp.position, inp.force - gravity - friction, s.error.y, dt)
    compare_step(s.presliding, friction + s.observer.disturbance, s.observer.velocity, dt)

    # What presses on the hand.
    s.held = envelope(s.held, handle, dt)
    s.driven = envelope(s.driven, inp.velocity, dt, STOPPED)
    lively = max(s.friction, s.feedback, s.observing)  # weight of what the guard watches over
    pull = (1.0 - inp.slot_weight) * _spring(p, s, inp) + inp.slot_force
    if lively > 0.0:
        pull -= damper_force(s.guard.passivity, s.observer.velocity, lively, p.chatter_damping)
    desired = clamp(pull, -p.force_down, p.force_up)
    impedance = s.base * desired

    if lively > 0.0:
        least = (1.0 - OBSERVED * s.observing) * p.chatter_limit
        velocity = s.observer.velocity
        guard_step(s.guard, inp.force, impedance + inp.force, velocity, least, p.chatter_limit, dt)
    elif s.guard.share < 1.0 or s.guard.passivity.need > 0.0:
        forget(s.guard)  # without a gain there is nothing to reduce

    # Inertia, and what friction is left, by the force on the hand.
    wanted = clamp(impedance + _carried(p, s, handle), -p.force_down, p.force_up)
    carried = wanted - impedance
    feedback = _fed_back(p, s, impedance + handle, wanted + inp.force, dt)
    friction += s.observing * s.observer.disturbance
    feedback = _standing(p, s, impedance, friction + feedback) - friction
    opposed = _opposed(p, s, handle)

    asked = impedance + gravity + friction + (feedback + carried + opposed)
    force = slew(s.force, _limited(p, s.base, inp, asked, impedance), p.force_rate * dt)
    s.position, s.placed, s.force = inp.position, True, force
    remember(s.observer, force)  # as it is sent, after all limits
    return VerticalOutput(
        force, impedance, gravity, friction, feedback + opposed, carried,
        force != asked or desired != pull, s.setpoint.position, s.setpoint.velocity, s.guard.share,
    )  # fmt: skip


def _usable(inp: VerticalInput, dt: float) -> bool:
    """Return whether the inputs can be real; comparisons with NaN are false."""
    slot = abs(inp.slot_force) <= STRONGEST and 0.0 <= inp.slot_weight <= 1.0
    return slot and is_real(inp.position, inp.velocity, inp.force) and dt > 0.0


def _rest(p: VerticalSettings, s: VerticalState, position: float) -> VerticalOutput:
    """Return no force, the nut at a position [m]; only the force's filter goes on."""
    hold_at(s.setpoint, clamp(position, p.travel_low, p.travel_high))
    s.stiffness, s.damping, s.gain, s.gravity = p.stiffness, p.damping, p.force_gain, p.gravity
    s.base = s.friction = s.feedback = s.observing = 0.0
    s.position, s.placed, s.force = position, True, 0.0
    s.presliding.modelled, s.presliding.ratio = 0.0, 1.0
    s.fed = s.held = s.driven = 0.0
    settle(s.observer, position)
    clear(s.error)
    clear(s.speed)
    forget(s.guard)
    wanted = s.setpoint.position
    return VerticalOutput(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, False, wanted, 0.0, s.guard.share)


def _tune(p: VerticalSettings, s: VerticalState, dt: float) -> None:
    """Prepare all filters for a sample time dt [s]."""
    s.dt = dt
    tune(s.handle, p.force_cutoff, dt)
    tune(s.error, p.observer_cutoff, dt)
    tune(s.speed, CARRIED_HZ, dt)
    tune_guard(s.guard, dt)


def _follow(p: VerticalSettings, s: VerticalState, inp: VerticalInput, dt: float) -> None:
    """Move the set point; it follows the nut while the spring is off or a slot guides."""
    if s.base == 0.0 or inp.slot_weight >= 1.0:
        hold_at(s.setpoint, clamp(inp.position, p.travel_low, p.travel_high))
    if uses_impedance(inp.mode) and inp.slot_weight < 1.0:
        allowed = Range(p.travel_low, p.travel_high, p.setpoint_speed, p.setpoint_acceleration)
        follow(allowed, s.setpoint, inp.setpoint_position, inp.setpoint_velocity, dt)


def _fade(p: VerticalSettings, s: VerticalState, mode: int, dt: float) -> None:
    """Take values and weights closer to the settings and the mode, at limited rates."""
    share = dt / p.fade_time
    s.stiffness = slew(s.stiffness, p.stiffness, p.stiffness_rate * dt)
    s.damping = slew(s.damping, p.damping, p.damping_rate * dt)
    s.gain = slew(s.gain, p.force_gain, p.gain_rate * dt)
    s.gravity = slew(s.gravity, p.gravity, p.gravity_rate * dt)
    # The observer starts after the other parts: until then the amplifier's ramp may reduce the
    # torque, and the observer would take that for friction.
    observes = uses_observer(mode) and s.base == 1.0
    s.observing = slew(s.observing, 1.0 if observes else 0.0, share)
    s.base = slew(s.base, 1.0 if uses_impedance(mode) else 0.0, share)
    s.friction = slew(s.friction, 1.0 if uses_friction(mode) else 0.0, share)
    s.feedback = slew(s.feedback, 1.0 if uses_feedback(mode) else 0.0, share)


def _fed_forward(
    p: VerticalSettings, model: FrictionModel, s: VerticalState, inp: VerticalInput
) -> float:
    """Return the modelled friction that is fed forward [N] (thesis 6.4.2)."""
    travelled = inp.position - s.position
    stiffness = p.friction_stiffness
    presliding_step(s.presliding, model, stiffness, inp.position, inp.velocity, travelled)
    held = min(1.0, s.held / HELD)
    fraction = held * s.friction * p.friction_fraction + s.observing * p.observer_friction
    fed = clamp(fraction * s.presliding.modelled, -p.friction_limit, p.friction_limit)
    return s.guard.share * model_share(s.presliding) * fed


def _spring(p: VerticalSettings, s: VerticalState, inp: VerticalInput) -> float:
    """Return the force of spring and dampers [N] (thesis 3.3, eqs 3.3 and 6.1).

    OBSERVER damps the estimated velocity, which lags less than the filtered one, and at least as
    much as a released handle needs.
    """
    velocity = inp.velocity + s.observing * (s.observer.velocity - inp.velocity)
    damping = s.damping + s.observing * max(0.0, least_damping(p, s.stiffness) - s.damping)
    pull = s.stiffness * (s.setpoint.position - inp.position)
    return pull + damping * (s.setpoint.velocity - velocity)


def _carried(p: VerticalSettings, s: VerticalState, handle: float) -> float:
    """Return the force that accelerates a share of the mass for the hand [N]; ours.

    A force gain k leaves the hand with M / (1 + k). The share is for a mass that was measured: one
    too large would leave less than none. The filter's lag is a negative damper, which swings a
    handle that nobody holds: the force comes in with the hand's.
    """
    acceleration = derivative(s.speed, s.observer.velocity)
    mass = p.observer_inertia * s.guard.share * s.observing * p.mass
    return min(1.0, abs(handle) / FIRM) * mass / (1.0 + p.observer_gain) * acceleration


def _fed_back(
    p: VerticalSettings, s: VerticalState, remainder: float, error: float, dt: float
) -> float:
    """Return the force feedback [N] (thesis 6.4.3, eqs 6.6 to 6.8).

    Fpd + Fp is due to friction and inertia; a gain divides it by 1 + gain. It has no integral, so a
    limit downstream causes no windup. remainder: Fp filtered; error: OBSERVER filters the sum [N].
    """
    most = p.feedback_limit
    by_gain = clamp(s.guard.share * s.gain * remainder, -most, most)
    mean = 0.5 * (error + s.error.x)
    s.fed = leaky_gain(s.fed, mean, s.guard.share, p.observer_gain, p.observer_cutoff, dt)
    smoothed(s.error, error)
    return s.feedback * by_gain + s.observing * clamp(s.fed, -most, most)


def _standing(
    p: VerticalSettings, s: VerticalState, impedance: float, helping: float
) -> float:
    """Return what helps the hand against friction and inertia [N], bounded while the nut stands.

    What stands still against more than friction ever holds is an obstacle that the transducer does
    not feel. All of the force on the nut counts, the hand's and the spring's too.
    """
    driving = min(1.0, s.driven / DRIVING)
    most = p.standing_force + driving * (NOTHING_HOLDS - p.standing_force)
    most = max(0.0, most + LOADED * abs(impedance) - abs(s.error.y))
    return clamp(helping, -most, most)


def _opposed(p: VerticalSettings, s: VerticalState, handle: float) -> float:
    """Return what opposes a force on the hand beyond the endpoint's limits [N].

    A friction feed-forward that exceeds the real friction presses on a hand at rest. Without force
    feedback no other part corrects that.
    """
    beyond = min(0.0, handle + p.force_up) + max(0.0, handle - p.force_down)
    weight = s.friction * (1.0 - s.feedback)
    if weight == 0.0:
        return 0.0
    return weight * clamp(s.gain * beyond, -p.feedback_limit, p.feedback_limit)


def _limited(
    p: VerticalSettings, weight: float, inp: VerticalInput, force: float, pressed: float
) -> float:
    """Return the force [N] after speed limits, force limits and soft stops.

    The speed limit near an end leaves the way and the time in which the force turns round, so that
    the hand is at rest before the soft stop. weight: fades the limits' own forces, so that the
    force in OFF is zero; pressed: what spring and dampers press on the hand [N]: with it, the
    limits' own forces keep to the endpoint's limits. Once a tick: `min` and `max` cost less there
    than `clamp`.
    """
    velocity, band, zone = inp.velocity, p.speed_band, p.soft_stop_zone
    reaction = (p.command_up + p.command_down) / p.force_rate
    near_end = braking_speed(
        p.edge_braking, reaction, inp.position, velocity, p.travel_low + zone, p.travel_high - zone
    )
    stop = (p.travel_low, p.travel_high, zone)
    force = limit_speed(force, velocity, min(p.speed_limit, near_end), band, 0.0)
    force = min(max(force, -p.command_down), p.command_up)
    force = soft_stop(force, inp.position, *stop, 0.0)
    own = limit_speed(0.0, velocity, p.speed_limit, band, p.speed_damping * weight)
    own = limit_speed(own, velocity, near_end, band, p.edge_damping * weight)
    own = soft_stop(own, inp.position, *stop, p.soft_stop_stiffness * weight)
    force += min(max(own, -p.force_down - pressed), p.force_up - pressed)
    return min(max(force, -p.command_down), p.command_up)
