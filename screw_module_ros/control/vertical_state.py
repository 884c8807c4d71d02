# SPDX-License-Identifier: Apache-2.0
"""Inputs, outputs and memory of the vertical law, and its states at rest."""

from __future__ import annotations

from typing import NamedTuple

from ..filters import LowpassState
from .chatter import QUIET_GUARD, GuardState
from .limits import clamp
from .observer import ObserverState, observer_at
from .outflow import NO_OUTFLOW, OutflowState
from .setpoint import SetPoint, at_rest
from .vertical_blend import Blend
from .vertical_settings import VerticalSettings


class VerticalInput(NamedTuple):
    """Inputs of one step, up positive.

    mode: constant of `modes`; position [m], velocity [m/s] of the nut; force: patient on robot,
    tared [N]; setpoint_position [m], NaN = none, also when the last one is stale; setpoint_velocity
    [m/s]; active: False holds the command at zero and the set point at the measured position;
    slot_force: of a slot (`slot`) [N]; slot_weight: 0 to 1, the share of spring and damper that the
    slot replaces.
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
    set point in use; share: of the force gain that the chatter guard leaves, 0 to 1.
    """

    force: float
    impedance: float
    gravity: float
    friction: float
    feedback: float
    saturated: bool
    desired_position: float
    desired_velocity: float
    share: float = 1.0


class VerticalState(NamedTuple):
    """Memory of the law.

    setpoint: in use; blend; lowpass: of the handle force; force: last command [N]; placed,
    position: of the last sample, where there was one [m]; friction: modelled, at full size [N];
    ratio: of friction found to it; observer; error_lowpass: of the force error that OBSERVER feeds
    back; speed_lowpass: of the estimated velocity, for the mass that is carried; guard: of the
    force gains; outflow: of power at the handle; held: largest recent handle force [N]; fastest:
    largest recent speed of the nut [m/s].
    """

    setpoint: SetPoint
    blend: Blend
    lowpass: LowpassState
    force: float
    placed: bool
    position: float
    friction: float
    ratio: float
    observer: ObserverState
    error_lowpass: LowpassState
    speed_lowpass: LowpassState
    guard: GuardState
    outflow: OutflowState
    held: float
    fastest: float


def initial_state(settings: VerticalSettings) -> VerticalState:
    """Return the state before the first step: everything at zero."""
    return unplaced(idle_state(settings, 0.0, LowpassState(0.0, 0.0), QUIET_GUARD))


def idle_state(
    settings: VerticalSettings, position: float, lowpass: LowpassState, guard: GuardState
) -> VerticalState:
    """Return the state without a command, set point at position [m]."""
    blend = Blend(
        settings.stiffness, settings.damping, settings.force_gain, settings.gravity, 0.0, 0.0, 0.0,
        0.0,
    )  # fmt: skip
    return VerticalState(
        setpoint_at(settings, position), blend, lowpass, 0.0, True, position, 0.0, 1.0,
        observer_at(position), LowpassState(0.0, 0.0), LowpassState(0.0, 0.0), guard,
        NO_OUTFLOW, 0.0, 0.0,
    )  # fmt: skip


def unplaced(state: VerticalState) -> VerticalState:
    """Return a state without the nut's last position."""
    return VerticalState(
        state.setpoint, state.blend, state.lowpass, state.force, False, state.position,
        state.friction, state.ratio, state.observer, state.error_lowpass, state.speed_lowpass,
        state.guard, state.outflow, state.held, state.fastest,
    )  # fmt: skip


def no_output(idle: VerticalState) -> VerticalOutput:
    """Return the output of a step without a command, from an idle state."""
    return VerticalOutput(
        0.0, 0.0, 0.0, 0.0, 0.0, False, idle.setpoint.position, 0.0, idle.guard.share
    )


def setpoint_at(settings: VerticalSettings, position: float) -> SetPoint:
    """Return a set point at rest at a position [m], or at the nearest end of travel."""
    return at_rest(clamp(position, settings.travel_low, settings.travel_high))
