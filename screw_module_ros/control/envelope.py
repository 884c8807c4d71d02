# SPDX-License-Identifier: Apache-2.0
"""The envelope of every vertical law: one tick from a sample to a command, and its bounds.

::

    sample -> real? -> set point, fades -> law.foresee -> estimate -> law.ask -> 65 N up, 45 N down
      + support -> guard -> law.help -> standing bound -> + weight -> speed limit -> force limits
      -> soft stops -> rate limit -> command

What a law asks for on the hand stays within the limits of the endpoint (thesis 2.1.1), together
with the support that carries the patient's arm (`support`). The support is no law's: it stays while
one law makes room for another, and as long as it lasts the module's weight is carried too. The
total command also carries that weight and overcomes friction; its limits are 95 N and 75 N.

Nothing jumps. A law fades in and out over `fade_time`. Stiffness, damping, gravity and set point
change at limited rates. The command changes by at most `force_rate` dt per step, 2 N at 1 kHz by
default, also at a change of mode. Enabling is a change from OFF, with the set point at the measured
position. Only a step to zero is exempt.

All memory is one record that a step changes in place. In the path of a tick `min` and `max` stand
in place of `clamp`, which costs a call.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from ..filters import Lowpass, clear, envelope, smoothed, tune
from .gain_guard import (
    GainGuard,
    damper_force,
    forget,
    guard_step,
    largest_raise,
    raise_corner,
    tune_guard,
)
from .law import Law, Motion, Sample
from .limits import (
    DRIVING,
    LONGEST_STEP,
    NUMBER,
    STOPPED,
    STRONGEST,
    braking_speed,
    clamp,
    is_real,
    limit_speed,
    slew,
    soft_stop,
)
from .observer import Observer, observe, remember, settle
from .setpoint import Range, SetPoint, follow, hold_at
from .vertical import VerticalInput, VerticalOutput
from .vertical_settings import VerticalSettings

LEAVE = -100
"""Mode of a law that makes room for another one: the law fades, weight and limits stay. Never sent
by anybody."""
NOTHING_HOLDS = 200.0  # [N] more than all parts together
LOADED = 0.2  # largest share of the force on the hand that a loaded screw adds to its friction
DAMPER = 31.0
"""Corner of the guard's damper [rad/s], 5 Hz: above a hand's own motion, below that of a wall."""
OBSERVED = 0.35
"""Share of `chatter_limit` from which an oscillation of a leaky gain counts."""
QUIET = 0.2
"""Share of it that chatter may have while the handle rests: the play does not knock. In motion
it takes a raised corner back."""


@dataclass(slots=True)
class EnvelopeState:
    """Memory of the envelope; `initial_state` makes one.

    law: memory of the law; mode: last one that was the law's; dt: for which the filters are tuned
    [s]; placed: `position`, of the last sample [m], is known; wrong: the law's last answer was no
    number; force: last command [N];
    stiffness [N/m], damping [Ns/m], gravity [N]: in use, while they follow their settings; weights
    while they fade, 0 to 1: base, of what carries the weight and of the limits' own forces, and
    weight, of the law; driven: largest speed of the nut in the last moments [m/s]; low passes of
    handle force and force error.
    """

    law: Any
    mode: int = 0
    dt: float = 0.0
    placed: bool = False
    wrong: bool = False
    position: float = 0.0
    force: float = 0.0
    setpoint: SetPoint = field(default_factory=SetPoint)
    stiffness: float = 0.0
    damping: float = 0.0
    gravity: float = 0.0
    base: float = 0.0
    weight: float = 0.0
    observer: Observer = field(default_factory=Observer)
    guard: GainGuard = field(default_factory=GainGuard)
    driven: float = 0.0
    handle: Lowpass = field(default_factory=Lowpass)
    error: Lowpass = field(default_factory=Lowpass)


Step = Callable[[VerticalSettings, Any, Any, VerticalInput, float], VerticalOutput]
"""settings of the envelope, what the law's functions get, memory, input, dt [s] -> command."""


def enveloped(law: Law) -> Step:
    """Return the step of a law within the envelope; it takes the memory dt [s] further.

    An input that is not finite or not plausible gives zero output; the caller latches a fault. So
    does an answer of the law that is no number, which is `EnvelopeState.wrong`.
    """
    foresee, ask, help_, rest, heeds = law.foresee, law.ask, law.help, law.rest, law.heeds
    lowest, highest = min(law.variants), max(law.variants)

    def step(
        p: VerticalSettings, own: Any, s: EnvelopeState, inp: VerticalInput, dt: float
    ) -> VerticalOutput:
        s.wrong = False
        if not _usable(inp, dt):
            rest(own, s.law)
            nothing = _rest(p, s, s.setpoint.position)
            s.placed = (
                False  # the position of the nut is unknown: the next good sample is the first
            )
            return nothing
        dt = min(dt, LONGEST_STEP)
        if dt != s.dt or p.force_cutoff != s.handle.cutoff or p.observer_cutoff != s.error.cutoff:
            _tune(p, s, dt)
        handle = smoothed(s.handle, inp.force)
        if not inp.active:
            rest(own, s.law)
            return _rest(p, s, inp.position)
        if not s.placed:
            s.position = inp.position
            settle(s.observer, inp.position)
        runs, settled = lowest <= inp.mode <= highest, s.weight == 1.0
        mode = inp.mode if runs or heeds else s.mode  # a law that leaves sees its own mode
        s.mode = mode
        _follow(p, s, inp, runs, dt)
        _fade(p, s, runs, runs or inp.mode == LEAVE or inp.support != 0.0, dt)

        # What the law feeds forward; the estimate takes it as known.
        gravity = s.base * s.gravity
        travelled = inp.position - s.position
        sample = Sample(
            dt, mode, inp.position, travelled, inp.velocity, inp.force, handle,
            s.guard.share, settled, s.force, s.guard.corner,
        )  # fmt: skip
        kept = 1.0 if heeds else s.weight * s.guard.share
        most = math.inf if heeds else p.friction_limit
        fed = float(foresee(own, s.law, sample))
        foreseen = min(max(kept * fed, -most), most)
        observe(p, s.observer, inp.position, inp.force - gravity - foreseen, s.error.y, dt)
        motion = Motion(
            s.setpoint.position, s.setpoint.velocity, s.stiffness, s.damping, s.observer.velocity,
            s.observer.disturbance, foreseen, s.error.x, s.error.y,
        )  # fmt: skip

        # What presses on the hand.
        asked = ask(own, s.law, sample, motion)
        wished = float(asked.pull)
        if not fed * fed + wished * wished <= NUMBER * NUMBER:  # NaN neither
            return _unanswered(p, s, inp.position)
        s.driven = envelope(s.driven, inp.velocity, dt, STOPPED)
        lively = asked.watched if heeds else s.weight  # weight of what the guard watches over
        pull = (1.0 - inp.slot_weight) * wished + inp.slot_force
        if lively > 0.0:
            pull -= damper_force(s.guard, motion.speed, lively, p.chatter_damping)
        support = inp.support
        desired = min(max(pull, -p.force_down - support), p.force_up - support)
        impedance = _pressed(p, s.weight * desired, support)

        if lively > 0.0:
            leaky = asked.leaky if heeds else 0.0
            _judge(p, s, inp.force, impedance + inp.force, leaky, dt)
        elif s.guard.share < 1.0 or s.guard.passivity.need > 0.0 or s.guard.corner > 1.0:
            forget(s.guard)  # without a gain there is nothing to reduce

        # Inertia, and what friction is left, by the force on the hand.
        sample = Sample(
            dt, mode, inp.position, travelled, inp.velocity, inp.force, handle,
            s.guard.share, settled, s.force, s.guard.corner,
        )  # fmt: skip
        helped = help_(own, s.law, sample, motion, impedance)
        friction, feedback = float(helped.friction), float(helped.feedback)
        wanted, relief = float(helped.wanted), float(helped.relief)
        size = friction * friction + feedback * feedback + wanted * wanted + relief * relief
        if not size <= NUMBER * NUMBER:
            return _unanswered(p, s, inp.position)
        if not heeds:
            kept, most, relief = s.weight * s.guard.share, p.feedback_limit, 0.0
            friction = clamp(kept * friction + foreseen, -most, most)
            feedback = clamp(friction + kept * feedback, -most, most) - friction
            wanted = impedance + kept * (wanted - impedance)
        wanted = min(max(wanted, -p.force_down), p.force_up)
        smoothed(s.error, wanted + inp.force)
        carried = wanted - impedance
        feedback = _standing(p, s, impedance, friction + feedback) - friction

        total = impedance + gravity + friction + (feedback + carried + relief)
        force = slew(s.force, _limited(p, s.base, inp, total, impedance), p.force_rate * dt)
        s.position, s.placed, s.force = inp.position, True, force
        remember(s.observer, force)  # as it is sent, after all limits
        return VerticalOutput(
            force, impedance, gravity, friction, feedback + relief, carried,
            force != total or desired != pull, s.setpoint.position, s.setpoint.velocity,
            s.guard.share,
        )  # fmt: skip

    return step


def initial_state(p: VerticalSettings, law: Law, own: Any) -> EnvelopeState:
    """Return the state before the first step: everything at zero."""
    state = EnvelopeState(law.memory(own))
    law.rest(own, state.law)
    _rest(p, state, 0.0)
    state.placed = False
    return state


def _usable(inp: VerticalInput, dt: float) -> bool:
    """Return whether the inputs can be real; comparisons with NaN are false."""
    slot = abs(inp.slot_force) <= STRONGEST and 0.0 <= inp.slot_weight <= 1.0
    sample = is_real(inp.position, inp.velocity, inp.force) and dt > 0.0
    return slot and sample and abs(inp.support) <= STRONGEST


def _rest(p: VerticalSettings, s: EnvelopeState, position: float) -> VerticalOutput:
    """Return no force, the nut at a position [m]; only the force's filter goes on."""
    hold_at(s.setpoint, clamp(position, p.travel_low, p.travel_high))
    s.stiffness, s.damping, s.gravity = p.stiffness, p.damping, p.gravity
    s.base = s.weight = 0.0
    s.position, s.placed, s.force = position, True, 0.0
    s.driven = 0.0
    settle(s.observer, position)
    clear(s.error)
    forget(s.guard)
    wanted = s.setpoint.position
    return VerticalOutput(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, False, wanted, 0.0, s.guard.share)


def _unanswered(p: VerticalSettings, s: EnvelopeState, position: float) -> VerticalOutput:
    """Return no force: the law's answer is no number."""
    nothing = _rest(p, s, position)
    s.wrong = True
    return nothing


def _tune(p: VerticalSettings, s: EnvelopeState, dt: float) -> None:
    """Prepare all filters for a sample time dt [s]."""
    s.dt = dt
    tune(s.handle, p.force_cutoff, dt)
    tune(s.error, p.observer_cutoff, dt)
    tune_guard(s.guard, dt)


def _follow(
    p: VerticalSettings, s: EnvelopeState, inp: VerticalInput, runs: bool, dt: float
) -> None:
    """Move the set point; it follows the nut while the law is off or a slot guides."""
    if s.weight == 0.0 or inp.slot_weight >= 1.0:
        hold_at(s.setpoint, clamp(inp.position, p.travel_low, p.travel_high))
    if runs and inp.slot_weight < 1.0:
        allowed = Range(p.travel_low, p.travel_high, p.setpoint_speed, p.setpoint_acceleration)
        follow(allowed, s.setpoint, inp.setpoint_position, inp.setpoint_velocity, dt)


def _fade(p: VerticalSettings, s: EnvelopeState, runs: bool, carries: bool, dt: float) -> None:
    """Take values and weights closer to the settings and the mode, at limited rates."""
    share = dt / p.fade_time
    s.stiffness = slew(s.stiffness, p.stiffness, p.stiffness_rate * dt)
    s.damping = slew(s.damping, p.damping, p.damping_rate * dt)
    s.gravity = slew(s.gravity, p.gravity, p.gravity_rate * dt)
    s.base = slew(s.base, 1.0 if carries else 0.0, share)
    s.weight = slew(s.weight, 1.0 if runs else 0.0, share)


def _pressed(p: VerticalSettings, asked: float, support: float) -> float:
    """Return what presses on the hand [N]: what the law asks for and the support."""
    if support == 0.0:
        return asked
    return min(max(asked + support, -p.force_down), p.force_up)


def _judge(
    p: VerticalSettings, s: EnvelopeState, force: float, error: float, leaky: float, dt: float
) -> None:
    """Let the guard judge a sample: the patient's force and the same with the impedance's [N].

    leaky: weight of a gain whose corner follows, 0 to 1.
    """
    least = (1.0 - (1.0 - OBSERVED) * leaky) * p.chatter_limit
    rough, moves = QUIET * p.chatter_limit, min(1.0, s.driven / DRIVING)
    limit = rough + moves * (p.chatter_limit - rough)
    guard_step(s.guard, force, error, s.observer.velocity, least, limit, dt, DAMPER)
    if leaky > 0.0:
        most = largest_raise(p.observer_gain, p.observer_cutoff, p.observer_delay, dt)
        raise_corner(s.guard, most, rough, dt)


def _standing(p: VerticalSettings, s: EnvelopeState, impedance: float, helping: float) -> float:
    """Return what helps the hand against friction and inertia [N], bounded while the nut stands.

    What stands still against more than friction ever holds is an obstacle that the transducer does
    not feel. All of the force on the nut counts, the hand's and the spring's too.
    """
    driving = min(1.0, s.driven / DRIVING)
    most = p.standing_force + driving * (NOTHING_HOLDS - p.standing_force)
    most = max(0.0, most + LOADED * abs(impedance) - abs(s.error.y))
    return min(max(helping, -most), most)


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
