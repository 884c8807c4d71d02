# SPDX-License-Identifier: Apache-2.0
"""The whole vertical law: from one encoder sample and one handle force to one force command.

::

    set point -> spring and damper -> + gravity -> + friction model -> + force feedback
              -> speed limit -> force limits -> soft stops -> rate limit -> command

Command (thesis eqs 6.1 to 6.8, figs 6-6 and 6-11): Fpd + gravity + 0.9 Ff(z, v) + Kf (Fpd + Fp).
The mode decides whether the last two parts take part. COMBINED is the plain sum: the friction model
removes the predicted part from Fpd + Fp, so the feedback acts on the remainder only (6.4.4). Near
standstill the model gives no information (6.3.1), and the feedback compensates friction alone.

Nothing jumps. Each part fades in and out over `fade_time` with its own weight. Stiffness, damping,
force gain, gravity and set point change at limited rates. The command changes by at most
`force_rate` dt per step, 2 N at 1 kHz by default, also at a change of mode. Enabling is a change
from OFF, with the set point at the measured position. Only a step to zero is exempt.

The limits of 65 N up and 45 N down (thesis 2.1.1) apply at the endpoint: they limit spring and
damper, which is the force on the patient's hand, and the feedback does not exceed them. The total
command also carries the weight and overcomes friction; its limits are 95 N and 75 N.
"""

from __future__ import annotations

import math

from ..filters import lowpass_coefficients, lowpass_step
from .carried_mass import carried_step
from .chatter import damper_share, guard_step
from .force_feedback import feedback_force
from .friction import FrictionModel
from .hold import free_share, hold_step
from .impedance import spring_damper
from .limits import clamp, limit_speed, slew, soft_stop
from .modes import uses_impedance
from .observer import least_damping, observer_at, observer_step, remembered
from .outflow import feeds, outflow_step
from .presliding import presliding_step, ratio_step, trusted
from .setpoint import Range, SetPoint, follow
from .standstill import standstill_step
from .vertical_blend import Blend, blended
from .vertical_settings import VerticalSettings
from .vertical_state import (
    VerticalInput,
    VerticalOutput,
    VerticalState,
    idle_state,
    no_output,
    setpoint_at,
    unplaced,
)

LONGEST_STEP = 0.02  # [s]; a longer dt counts as this one, so that a pause makes no large step
# A sample beyond these cannot be real; the output is then zero.
FARTHEST = 10.0  # [m]
FASTEST = 100.0  # [m/s]
STRONGEST = 1e5  # [N]
RESTING_SPEED = 3e-4  # [m/s]
FED_SHARE = 0.92  # of `chatter_limit`, from which an oscillation that the robot feeds counts


def vertical_step(
    settings: VerticalSettings,
    friction_model: FrictionModel,
    state: VerticalState,
    inp: VerticalInput,
    dt: float,
) -> tuple[VerticalOutput, VerticalState]:
    """Return command and next state, dt [s] after the last step.

    An input that is not finite or not plausible gives zero output; the caller latches a fault.
    """
    if not _usable(inp, dt):
        # The position of the nut is unknown now: the next good sample counts as the first one.
        idle = idle_state(settings, state.setpoint.position, state.lowpass, state.guard)
        return no_output(idle), unplaced(idle)
    dt = min(dt, LONGEST_STEP)
    coefficients = lowpass_coefficients(settings.force_cutoff, dt)
    handle_force, lowpass = lowpass_step(coefficients, state.lowpass, inp.force)
    guard = guard_step(
        state.guard, inp.force, feeds(state.outflow), _guard_limit(settings, state), dt
    )
    if not inp.active:
        idle = idle_state(settings, inp.position, lowpass, guard)
        return no_output(idle), idle

    last, observed = state.position, state.observer
    if not state.placed:
        last, observed = inp.position, observer_at(inp.position)
    setpoint = _followed(settings, state, inp, dt)
    blend = blended(settings, state.blend, inp.mode, dt)
    modelled = presliding_step(
        friction_model, settings.friction_stiffness, state.friction, inp.position, inp.velocity,
        inp.position - last,
    )  # fmt: skip
    friction = guard.share * trusted(state.ratio) * _friction(settings, blend, modelled)
    gravity = blend.base * blend.gravity
    observer = observer_step(
        observed, inp.position, inp.force - gravity - friction, settings.mass,
        settings.observer_bandwidth, settings.observer_delay, settings.observer_limit,
        _resting(settings, state), dt,
    )  # fmt: skip
    ratio = ratio_step(
        state.ratio, modelled, friction + observer.disturbance, observer.velocity, dt
    )
    outflow = outflow_step(
        state.outflow, inp.force, observer.velocity, FED_SHARE * settings.chatter_limit, dt
    )
    held = hold_step(state.held, handle_force, dt)
    spring = _pull(
        settings, blend, setpoint, inp, observer.velocity, damper_share(guard), free_share(held)
    )
    at_rest, fastest = standstill_step(
        blend.observer * settings.rest_damping, state.fastest, observer.velocity, dt
    )
    pull = (1.0 - inp.slot_weight) * (spring + at_rest) + inp.slot_force
    desired = clamp(pull, -settings.force_down, settings.force_up)
    impedance = blend.base * desired
    share = settings.observer_inertia * guard.share * blend.observer
    carried, speed_lowpass = carried_step(
        state.speed_lowpass, observer.velocity, share * settings.mass,
        settings.observer_gain, handle_force, dt,
    )  # fmt: skip
    wanted = clamp(impedance + carried, -settings.force_down, settings.force_up)
    error, error_lowpass = lowpass_step(
        lowpass_coefficients(settings.observer_cutoff, dt),
        state.error_lowpass,
        wanted + inp.force,
    )
    feedback = blend.feedback * feedback_force(
        guard.share * blend.gain, impedance, handle_force, settings.feedback_limit
    )
    feedback += blend.observer * feedback_force(
        guard.share * settings.observer_gain, error, 0.0, settings.feedback_limit
    )
    feedback += wanted - impedance
    unfelt = blend.friction * (1.0 - blend.feedback)
    feedback += unfelt * _over_limit(settings, blend, handle_force)
    friction += blend.observer * observer.disturbance
    asked = impedance + gravity + friction + feedback
    allowed = _limited(settings, blend.base, inp, asked, impedance)
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
        guard.share,
    )
    observer = remembered(observer, force)
    return output, VerticalState(
        setpoint, blend, lowpass, force, True, inp.position, modelled, ratio, observer,
        error_lowpass, speed_lowpass, guard, outflow, held, fastest,
    )  # fmt: skip


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


def _followed(
    settings: VerticalSettings, state: VerticalState, inp: VerticalInput, dt: float
) -> SetPoint:
    """Return the next set point; it follows the nut while the spring is off or a slot guides."""
    setpoint = state.setpoint
    if state.blend.base == 0.0 or inp.slot_weight >= 1.0:
        setpoint = setpoint_at(settings, inp.position)
    if not uses_impedance(inp.mode) or inp.slot_weight >= 1.0:
        return setpoint
    allowed = Range(
        settings.travel_low,
        settings.travel_high,
        settings.setpoint_speed,
        settings.setpoint_acceleration,
    )
    return follow(allowed, setpoint, inp.setpoint_position, inp.setpoint_velocity, dt)


def _friction(settings: VerticalSettings, blend: Blend, modelled: float) -> float:
    """Return the friction feed-forward [N]; modelled: at full size [N]."""
    share = blend.friction * settings.friction_fraction
    share += blend.observer * settings.observer_friction
    return clamp(share * modelled, -settings.friction_limit, settings.friction_limit)


def _over_limit(settings: VerticalSettings, blend: Blend, handle_force: float) -> float:
    """Return the force [N] that opposes a force on the hand beyond the endpoint's limits.

    A friction feed-forward that exceeds the real friction presses on a hand at rest. Without force
    feedback no other part corrects that.
    """
    beyond = min(0.0, handle_force + settings.force_up)
    beyond += max(0.0, handle_force - settings.force_down)
    return feedback_force(blend.gain, beyond, 0.0, settings.feedback_limit)


def _guard_limit(settings: VerticalSettings, state: VerticalState) -> float:
    """Return the limit of the chatter guard [N], infinite while it has nothing to reduce.

    The law does not shake the handle then: somebody mounts it, or it hits a stop without torque.
    """
    blend = state.blend
    lively = max(blend.friction, blend.feedback, blend.observer)
    return settings.chatter_limit if lively > 0.0 else math.inf


def _resting(settings: VerticalSettings, state: VerticalState) -> bool:
    """Return whether the handle is at rest with a tolerable force error.

    Friction holds it there. An observer that continued would build up force until the handle breaks
    away and overshoots: hunting, as with any integral action against stiction.
    """
    return (
        abs(state.observer.velocity) < RESTING_SPEED
        and abs(state.error_lowpass.y) < settings.observer_rest
    )


def _pull(
    settings: VerticalSettings,
    blend: Blend,
    setpoint: SetPoint,
    inp: VerticalInput,
    estimated: float,
    guarded: float,
    free: float,
) -> float:
    """Return the force of spring and damper [N].

    OBSERVER uses the velocity estimated by its observer [m/s], which lags less than the filtered
    one. Its damping never falls below the least damping that it needs, whatever the settings are
    now. guarded: weight of the chatter guard's damper, 0 to 1; free: 1 when nobody holds the
    handle, 0 when somebody holds it firmly.
    """
    weight = blend.observer
    velocity = inp.velocity + weight * (estimated - inp.velocity)
    least = least_damping(
        blend.stiffness, settings.mass, settings.observer_gain, settings.observer_cutoff,
        settings.observer_delay, settings.observer_damping_ratio,
    )  # fmt: skip
    damping = blend.damping + weight * max(0.0, least - blend.damping)
    lively = max(weight, blend.feedback, blend.friction)
    damping += lively * guarded * settings.chatter_damping
    damping += blend.friction * free * settings.free_damping
    return spring_damper(
        blend.stiffness,
        damping,
        setpoint.position - inp.position,
        setpoint.velocity - velocity,
    )


def _limited(
    settings: VerticalSettings, weight: float, inp: VerticalInput, force: float, pressed: float
) -> float:
    """Return the force [N] after speed limit, force limits and soft stops.

    weight fades the forces of the limits themselves, so that the force in OFF is zero. pressed: of
    it, what spring and damper press on the hand [N]; together with that, a soft stop keeps to the
    endpoint's limits.
    """
    damping = settings.speed_damping * weight
    force = limit_speed(force, inp.velocity, settings.speed_limit, settings.speed_band, damping)
    force = clamp(force, -settings.command_down, settings.command_up)
    stop = (settings.travel_low, settings.travel_high, settings.soft_stop_zone)
    force = soft_stop(force, inp.position, *stop, 0.0)
    inward = soft_stop(0.0, inp.position, *stop, settings.soft_stop_stiffness * weight)
    force += clamp(inward, -settings.force_down - pressed, settings.force_up - pressed)
    return clamp(force, -settings.command_down, settings.command_up)
