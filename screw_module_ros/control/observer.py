# SPDX-License-Identifier: Apache-2.0
"""Disturbance observer of mode OBSERVER: estimates friction from the nut's motion (thesis 7.1).

An extended-state observer round the collocated encoder, with the handle force as a known input
(natural admittance control in spirit: Newman 1992; Buerger and Hogan 2007). It compares the motion
of the nut with that of a mass without friction,

    x' = v,   M v' = u(t - tau) + Fp - g - F - d,

u the command that acts now, tau [s] after it was computed, Fp the patient's force, g the carried
weight, F the modelled friction that is fed forward. The remainder is d: friction outside the model,
an error of the weight, a bias. The law feeds d back to cancel it. No term depends on the sign of
the velocity, so the observer works through zero speed. Each sample corrects the three estimates
with a triple pole at exp(-w dt), which fixes the gains for any sample time (the fading memory
filter of second order; Morrison 1969).

The observer gets the command that was sent, after all limits, so a limit causes no windup. An
obstacle that does not press on the transducer looks like friction, so d is limited.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from .limits import clamp

KEPT = 12
"""Commands remembered; the observer models a delay of up to this number of periods less two."""

Commands = tuple[
    float, float, float, float, float, float, float, float, float, float, float, float
]
NO_COMMANDS: Commands = (0.0,) * KEPT


class ObserverState(NamedTuple):
    """Estimated position [m] and velocity [m/s] of the nut, disturbance [N]; commands: those sent,
    newest first [N]."""

    position: float
    velocity: float
    disturbance: float
    commands: Commands


def observer_at(position: float) -> ObserverState:
    """Return the observer of a nut at rest at position [m], without a command."""
    return ObserverState(position, 0.0, 0.0, NO_COMMANDS)


def observer_step(
    state: ObserverState,
    position: float,
    force: float,
    mass: float,
    bandwidth: float,
    delay: float,
    limit: float,
    resting: bool,
    dt: float,
) -> ObserverState:
    """Return the estimates at a new sample, dt [s] after the last one.

    position: measured [m]; force: known forces on the nut without the command, Fp - g - F [N]; mass
    M [kg]; bandwidth w [rad/s]; delay tau [s]; limit: of the disturbance [N]; resting: True keeps
    the disturbance unchanged.
    """
    acting = command_in_force(state.commands, delay / dt)
    acceleration = (acting + force - state.disturbance) / mass
    ahead = state.position + dt * (state.velocity + 0.5 * dt * acceleration)
    off = position - ahead
    pole = math.exp(-bandwidth * dt)
    left = 1.0 - pole
    rate = left / dt  # no dt squared below: the square of a tiny dt underflows to zero
    disturbance = state.disturbance
    if not resting:
        disturbance -= mass * left * rate * rate * off
    return ObserverState(
        ahead + (1.0 - pole * pole * pole) * off,
        state.velocity + dt * acceleration + 1.5 * left * rate * (1.0 + pole) * off,
        clamp(disturbance, -limit, limit),
        state.commands,
    )


def command_in_force(commands: Commands, periods: float) -> float:
    """Return the mean command over the last period [N]; periods: its delay in periods."""
    periods = clamp(periods, 0.0, KEPT - 2.0)
    whole = int(periods)
    part = periods - whole
    return (1.0 - part) * commands[whole] + part * commands[whole + 1]


def remembered(state: ObserverState, command: float) -> ObserverState:
    """Return the state with the command [N] that is sent now."""
    c = state.commands
    return ObserverState(
        state.position,
        state.velocity,
        state.disturbance,
        (command, c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8], c[9], c[10]),
    )


def least_damping(
    stiffness: float, mass: float, gain: float, cutoff: float, delay: float, ratio: float
) -> float:
    """Return the damping with which a released handle comes to rest [Ns/m].

    Without friction and hand, spring and damper move the apparent mass M / (1 + k). The filter of
    the force gain k and the delay shift the phase of the spring's force; that acts as the negative
    damping K (k / ((1 + k) 2 pi fc) + tau). The damping ratio adds 2 zeta sqrt(K M / (1 + k)).

    stiffness K [N/m], mass M [kg], gain k, cutoff fc [Hz], delay tau [s], ratio zeta; zeta = 0
    returns 0.
    """
    if ratio <= 0.0:
        return 0.0
    lag = gain / ((1.0 + gain) * 2.0 * math.pi * cutoff) + delay
    return stiffness * lag + 2.0 * ratio * math.sqrt(stiffness * mass / (1.0 + gain))
