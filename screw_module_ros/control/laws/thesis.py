# SPDX-License-Identifier: Apache-2.0
"""The thesis's compensators and the observer: modes 1 to 5, one law, since they fade into each
other (thesis chapter 6; `docs/control.md` draws each).

All five ask for spring and dampers. They compensate friction by its model (eqs 6.2 to 6.5, fig
6-6), friction and inertia by the force on the hand (eqs 6.6 to 6.8, fig 6-11), by both, or by the
estimated disturbance (ours). COMBINED is the plain sum: the friction model removes the predicted
part from pressed + force (Fpd + Fp there), so the feedback acts on the remainder only (6.4.4). Each
part fades in and out over `fade_time` with its own weight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

from ...filters import Lowpass, clear, derivative, envelope, tune
from ..friction import FrictionModel, Presliding, compare_step, model_share, presliding_step
from ..gain_guard import leaky_gain
from ..law import FRICTION, LINEAR, MASS, Asked, Help, Law, Margin, Motion, Robot, Sample, Variant
from ..limits import clamp, slew
from ..modes import COMBINED, FORCE_FEEDBACK, FRICTION_COMPENSATION, IMPEDANCE, OBSERVER
from ..vertical_settings import CARRIED_HZ, VerticalSettings, least_damping

HELD = 0.8  # [N] largest recent force from which a hand holds the handle
FIRM = 1.0  # [N] of the hand from which the carried mass is in with all of its share


class Own(NamedTuple):
    """Numbers of the compensators, and the model of this module's friction."""

    p: VerticalSettings
    model: FrictionModel


@dataclass(slots=True)
class Memory:
    """Memory of the compensators.

    dt: for which the filter is tuned [s]; gain: Kf in use; weights of the parts while they fade, 0
    to 1: friction, feedback, observing; fed: feedback of OBSERVER [N]; held: largest recent handle
    force [N]; speed: low pass of the estimated speed.
    """

    dt: float = 0.0
    gain: float = 0.0
    friction: float = 0.0
    feedback: float = 0.0
    observing: float = 0.0
    fed: float = 0.0
    held: float = 0.0
    presliding: Presliding = field(default_factory=Presliding)
    speed: Lowpass = field(default_factory=Lowpass)


def rest(own: Own, m: Memory) -> None:
    """Forget the motion."""
    m.gain = own.p.force_gain
    m.friction = m.feedback = m.observing = 0.0
    m.presliding.modelled, m.presliding.ratio = 0.0, 1.0
    m.fed = m.held = 0.0
    clear(m.speed)


def foresee(own: Own, m: Memory, u: Sample) -> float:
    """Return the modelled friction that is fed forward [N] (thesis 6.4.2)."""
    p = own.p
    if u.dt != m.dt:
        m.dt = u.dt
        tune(m.speed, CARRIED_HZ, u.dt)
    share = u.dt / p.fade_time
    m.gain = slew(m.gain, p.force_gain, p.gain_rate * u.dt)
    # The observer starts after the other parts: until then the amplifier's ramp may reduce the
    # torque, and the observer would take that for friction.
    observes = u.mode == OBSERVER and u.settled
    m.observing = slew(m.observing, 1.0 if observes else 0.0, share)
    models = u.mode == FRICTION_COMPENSATION or u.mode == COMBINED
    feeds = u.mode == FORCE_FEEDBACK or u.mode == COMBINED
    m.friction = slew(m.friction, 1.0 if models else 0.0, share)
    m.feedback = slew(m.feedback, 1.0 if feeds else 0.0, share)
    stiffness = p.friction_stiffness
    presliding_step(m.presliding, own.model, stiffness, u.position, u.velocity, u.travelled)
    held = min(1.0, m.held / HELD)
    fraction = held * m.friction * p.friction_fraction + m.observing * p.observer_friction
    fed = clamp(fraction * m.presliding.modelled, -p.friction_limit, p.friction_limit)
    return u.share * model_share(m.presliding) * fed


def ask(own: Own, m: Memory, u: Sample, now: Motion) -> Asked:
    """Return the force of spring and dampers [N] (thesis 3.3, eqs 3.3 and 6.1).

    OBSERVER damps the estimated velocity, which lags less than the filtered one, and at least as
    much as a released handle needs.
    """
    compare_step(m.presliding, now.foreseen + now.disturbance, now.speed, u.dt)
    m.held = envelope(m.held, u.handle, u.dt)
    velocity = u.velocity + m.observing * (now.speed - u.velocity)
    enough = max(0.0, least_damping(own.p, now.stiffness) - now.damping)
    damping = now.damping + m.observing * enough
    pull = now.stiffness * (now.to_position - u.position)
    pull += damping * (now.to_velocity - velocity)
    return Asked(pull, max(m.friction, m.feedback, m.observing), m.observing)


def helps(own: Own, m: Memory, u: Sample, now: Motion, pressed: float) -> Help:
    """Return what helps against inertia and the friction that is left (thesis 6.4.3, 6.4.4)."""
    p = own.p
    wanted = clamp(pressed + _carried(p, m, u, now.speed), -p.force_down, p.force_up)
    feedback = _fed_back(p, m, u, pressed + u.handle, 0.5 * (wanted + u.force + now.error_x))
    friction = now.foreseen + m.observing * now.disturbance
    return Help(friction, feedback, wanted, _opposed(p, m, u.handle))


def _carried(p: VerticalSettings, m: Memory, u: Sample, speed: float) -> float:
    """Return the force that accelerates a share of the mass for the hand [N]; ours.

    A force gain k leaves the hand with M / (1 + k). The share is for a mass that was measured: one
    too large would leave less than none. The filter's lag is a negative damper, which swings a
    handle that nobody holds: the force comes in with the hand's.
    """
    acceleration = derivative(m.speed, speed)
    mass = p.observer_inertia * u.share * m.observing * p.mass
    return min(1.0, abs(u.handle) / FIRM) * mass / (1.0 + p.observer_gain) * acceleration


def _fed_back(p: VerticalSettings, m: Memory, u: Sample, remainder: float, mean: float) -> float:
    """Return the force feedback [N] (thesis 6.4.3, eqs 6.6 to 6.8).

    pressed + force is due to friction and inertia; a gain divides it by 1 + gain. It has no
    integral, so a limit downstream causes no windup. remainder: with `handle`, which is filtered;
    mean: over the sample, of the sum that OBSERVER filters [N].
    """
    most = p.feedback_limit
    by_gain = clamp(u.share * m.gain * remainder, -most, most)
    cutoff = p.observer_cutoff * u.corner
    m.fed = leaky_gain(m.fed, mean, u.share, p.observer_gain, cutoff, u.dt)
    return m.feedback * by_gain + m.observing * clamp(m.fed, -most, most)


def _opposed(p: VerticalSettings, m: Memory, handle: float) -> float:
    """Return what opposes a force on the hand beyond the endpoint's limits [N].

    A friction feed-forward that exceeds the real friction presses on a hand at rest. Without force
    feedback no other part corrects that.
    """
    weight = m.friction * (1.0 - m.feedback)
    if weight == 0.0:
        return 0.0
    beyond = min(0.0, handle + p.force_up) + max(0.0, handle - p.force_down)
    return weight * clamp(m.gain * beyond, -p.feedback_limit, p.feedback_limit)


def new_memory(own: Own) -> Memory:
    """Return the memory before the first sample."""
    return Memory()


def own_numbers(settings: VerticalSettings, robot: Robot) -> Own:
    """Return the settings with the model of this module's friction."""
    return Own(settings, robot.friction)


def refusal(settings: VerticalSettings, mode: int) -> str:
    """Return why the settings do not go with a mode: too little damping for OBSERVER."""
    if mode != OBSERVER or settings.damping >= settings.least_damping:
        return ""
    return (
        f"mode OBSERVER with a stiffness of {settings.stiffness:g} N/m needs a damping of "
        f"{math.ceil(10.0 * settings.least_damping) / 10.0:g} Ns/m or more, because it takes the "
        f"friction away that would bring a released handle to rest; it is {settings.damping:g} "
        "Ns/m: raise the damping first, or choose another mode"
    )


_FEEDBACK, _OBSERVED = ("force_gain",), ("observer_gain",)
# On the screw's axial support a faster loop feeds back more of a heavy arm's oscillation, so the
# rate must be that of the limits.
_MARGINS = (
    Margin("force_gain", "feedback", least=("rate",), most=("rate", "force_cutoff")),
    Margin(
        "observer_gain", "observer", least=("rate", "observer_bandwidth", "observer_delay", "mass"),
        most=("rate", "observer_cutoff", "observer_inertia"),
    ),
)  # fmt: skip
THESIS = Law(
    "thesis",
    {
        IMPEDANCE: Variant("IMPEDANCE"),
        FRICTION_COMPENSATION: Variant("FRICTION_COMPENSATION", uses=(FRICTION,)),
        FORCE_FEEDBACK: Variant("FORCE_FEEDBACK", _FEEDBACK, force=True),
        COMBINED: Variant("COMBINED", _FEEDBACK, force=True, uses=(FRICTION,)),
        OBSERVER: Variant("OBSERVER", _OBSERVED, force=True, uses=(MASS,)),
    },
    VerticalSettings, new_memory, foresee, ask, helps, rest, own_numbers, refusal, heeds=True,
    judged=LINEAR, margins=_MARGINS,
)  # fmt: skip
