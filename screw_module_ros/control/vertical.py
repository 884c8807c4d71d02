# SPDX-License-Identifier: Apache-2.0
"""The whole vertical law: from one encoder sample and one handle force to one force command.

::

    set point -> spring and damper -> + gravity -> + friction model -> + force feedback
              -> speed limit -> force limits -> soft stops -> rate limit -> command

Command (thesis eqs 6.1 to 6.8, figs 6-6 and 6-11): Fpd + gravity + 0.9 Ff(z, v) + Kf (Fpd + Fp),
the last two where the mode asks for them. COMBINED is the plain sum: what the friction model
predicts no longer shows up in Fpd + Fp, so the feedback works on the remainder by itself (6.4.4).
Near standstill the model says nothing (6.3.1) and the feedback does the work.

Nothing jumps. Every part fades in and out with a weight of its own over `fade_time`; stiffness,
damping, force gain, gravity and set point move at limited rates; and the command moves at most
`force_rate` dt per step whatever is switched: 2 N at 1 kHz by default. Enabling is such a switch,
from OFF, with the set point at the measured position. Only to zero may the command jump.

The limits of 65 N up and 45 N down (thesis 2.1.1) are those of the endpoint: they hold spring and
damper, so what the robot presses on the patient's hand, and the feedback asks no more. The total
command, which also carries the weight and overcomes friction, has limits of its own, 95 N and 75 N.
"""

from __future__ import annotations

from typing import NamedTuple

from ..filters import LowpassState, lowpass_coefficients, lowpass_step
from .force_feedback import feedback_force
from .friction import FrictionModel, friction_force
from .impedance import spring_damper
from .limits import clamp, limit_speed, slew, soft_stop
from .modes import uses_feedback, uses_friction, uses_impedance
from .setpoint import Range, SetPoint, follow
from .vertical_settings import VerticalSettings

LONGEST_STEP = 0.02  # [s]; a longer dt counts as this one, so that a pause makes no large step
# Beyond these no sample can be real: zero output.
FARTHEST = 10.0  # [m]
FASTEST = 100.0  # [m/s]
STRONGEST = 1e5  # [N]


class VerticalInput(NamedTuple):
    """What one step sees, up positive.

    mode: constant of `modes`; position [m], velocity [m/s] of the nut; force: patient on robot,
    tared [N]; setpoint_position [m], NaN = none, also when the last one is stale; setpoint_velocity
    [m/s]; active: False holds the command at zero and the set point at the measured position;
    slot_force: of a slot (`slot`) [N], slot_weight: 0 to 1, how far it stands in place of spring
    and damper.
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

    force: total after limits [N]; impedance, gravity, friction, feedback: its parts before the
    limits on the total [N]; saturated: a limit acted; desired_position [m], desired_velocity [m/s]:
    set point in use.
    """

    force: float
    impedance: float
    gravity: float
    friction: float
    feedback: float
    saturated: bool
    desired_position: float
    desired_velocity: float


class Blend(NamedTuple):
    """What is in force between two settings.

    stiffness [N/m], damping [Ns/m], gain [1], gravity [N]: in use; base, friction, feedback:
    weights of the parts, 0 to 1, base for spring, damper and gravity.
    """

    stiffness: float
    damping: float
    gain: float
    gravity: float
    base: float
    friction: float
    feedback: float


class VerticalState(NamedTuple):
    """Memory of the law: set point in use, blend, filter of the handle force, last command [N]."""

    setpoint: SetPoint
    blend: Blend
    lowpass: LowpassState
    force: float


def initial_state(settings: VerticalSettings) -> VerticalState:
    """Return the state before the first step: everything at zero."""
    return _idle(settings, 0.0, LowpassState(0.0, 0.0))


def vertical_step(
    settings: VerticalSettings,
    friction_model: FrictionModel,
    state: VerticalState,
    inp: VerticalInput,
    dt: float,
) -> tuple[VerticalOutput, VerticalState]:
    """Return command and next state, dt [s] after the last step.

    An input that is not finite or beyond anything real gives zero output; the caller latches.
    """
    if not _usable(inp, dt):
        idle = _idle(settings, state.setpoint.position, state.lowpass)
        return _nothing(idle), idle
    dt = min(dt, LONGEST_STEP)
    coefficients = lowpass_coefficients(settings.force_cutoff, dt)
    handle_force, lowpass = lowpass_step(coefficients, state.lowpass, inp.force)
    if not inp.active:
        idle = _idle(settings, inp.position, lowpass)
        return _nothing(idle), idle

    setpoint = _followed(settings, state, inp, dt)
    blend = _blended(settings, state.blend, inp.mode, dt)
    spring = spring_damper(
        blend.stiffness,
        blend.damping,
        setpoint.position - inp.position,
        setpoint.velocity - inp.velocity,
    )
    pull = (1.0 - inp.slot_weight) * spring + inp.slot_force
    desired = clamp(pull, -settings.force_down, settings.force_up)
    impedance = blend.base * desired
    gravity = blend.base * blend.gravity
    friction = _friction(settings, friction_model, inp) * blend.friction
    feedback = blend.feedback * feedback_force(
        blend.gain, impedance, handle_force, settings.feedback_limit
    )
    asked = impedance + gravity + friction + feedback
    allowed = _limited(settings, blend.base, inp, asked)
    force = slew(state.force, allowed, settings.force_rate * dt)
    output = VerticalOutput(
        force,
        impedance,
        gravity,
        friction,
        feedback,
        force != asked or desired != pull,
        setpoint.position,
        setpoint.velocity,
    )
    return output, VerticalState(setpoint, blend, lowpass, force)


def _usable(inp: VerticalInput, dt: float) -> bool:
    """Return whether the measurements can be real; comparisons with NaN are false."""
    return (
        abs(inp.position) <= FARTHEST
        and abs(inp.velocity) <= FASTEST
        and abs(inp.force) <= STRONGEST
        and abs(inp.slot_force) <= STRONGEST
        and 0.0 <= inp.slot_weight <= 1.0
        and dt > 0.0
    )


def _idle(settings: VerticalSettings, position: float, lowpass: LowpassState) -> VerticalState:
    """Return the state in which nothing is commanded, set point at position [m]."""
    blend = Blend(
        settings.stiffness, settings.damping, settings.force_gain, settings.gravity, 0.0, 0.0, 0.0
    )
    return VerticalState(_setpoint_at(settings, position), blend, lowpass, 0.0)


def _nothing(idle: VerticalState) -> VerticalOutput:
    return VerticalOutput(0.0, 0.0, 0.0, 0.0, 0.0, False, idle.setpoint.position, 0.0)


def _setpoint_at(settings: VerticalSettings, position: float) -> SetPoint:
    return SetPoint(clamp(position, settings.travel_low, settings.travel_high), 0.0)


def _followed(
    settings: VerticalSettings, state: VerticalState, inp: VerticalInput, dt: float
) -> SetPoint:
    """Return the set point moved on; it stays with the nut while no spring pulls or a slot does."""
    setpoint = state.setpoint
    if state.blend.base == 0.0 or inp.slot_weight >= 1.0:
        setpoint = _setpoint_at(settings, inp.position)
    if not uses_impedance(inp.mode) or inp.slot_weight >= 1.0:
        return setpoint
    allowed = Range(
        settings.travel_low,
        settings.travel_high,
        settings.setpoint_speed,
        settings.setpoint_acceleration,
    )
    return follow(allowed, setpoint, inp.setpoint_position, inp.setpoint_velocity, dt)


def _blended(settings: VerticalSettings, blend: Blend, mode: int, dt: float) -> Blend:
    """Return the blend moved on towards the settings and the mode."""
    share = dt / settings.fade_time
    return Blend(
        slew(blend.stiffness, settings.stiffness, settings.stiffness_rate * dt),
        slew(blend.damping, settings.damping, settings.damping_rate * dt),
        slew(blend.gain, settings.force_gain, settings.gain_rate * dt),
        slew(blend.gravity, settings.gravity, settings.gravity_rate * dt),
        slew(blend.base, 1.0 if uses_impedance(mode) else 0.0, share),
        slew(blend.friction, 1.0 if uses_friction(mode) else 0.0, share),
        slew(blend.feedback, 1.0 if uses_feedback(mode) else 0.0, share),
    )


def _friction(settings: VerticalSettings, model: FrictionModel, inp: VerticalInput) -> float:
    """Return the friction feed-forward at full weight [N]."""
    push = settings.friction_fraction * friction_force(model, inp.position, inp.velocity)
    return clamp(push, -settings.friction_limit, settings.friction_limit)


def _limited(settings: VerticalSettings, weight: float, inp: VerticalInput, force: float) -> float:
    """Return the force [N] after speed limit, force limits and soft stops.

    weight fades what the limits themselves push, so that OFF is zero force.
    """
    damping = settings.speed_damping * weight
    force = limit_speed(force, inp.velocity, settings.speed_limit, settings.speed_band, damping)
    force = clamp(force, -settings.command_down, settings.command_up)
    force = soft_stop(
        force,
        inp.position,
        settings.travel_low,
        settings.travel_high,
        settings.soft_stop_zone,
        settings.soft_stop_stiffness * weight,
    )
    return clamp(force, -settings.command_down, settings.command_up)
