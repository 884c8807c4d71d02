# SPDX-License-Identifier: Apache-2.0
"""Disturbance observer of mode OBSERVER: estimates friction from the nut's motion.

The thesis proposes an observer that uses friction model and interaction force (6.4.4); its form is
ours.

An extended-state observer round the collocated encoder, with the handle force as a known input
(natural admittance control in spirit: newman1992; buergerhogan2007). It compares the motion
of the nut with that of a mass without friction,

    position' = velocity,
    mass velocity' = sent(t - observer_delay) + force - weight - foreseen - disturbance,

`sent` the command that acts now, `force` the patient's, `weight` what is carried, `foreseen` the
modelled friction that is fed forward. The remainder is `disturbance`: friction outside the model,
an error of the weight, a bias. The law feeds it back to cancel it. No term depends on the sign of
the velocity, so the observer works through zero speed. Each sample corrects the three estimates
with a triple pole at exp(-w dt), which fixes the gains for any sample time (the fading memory
filter of second order; morrison1969).

The observer gets the command that was sent, after all limits, so a limit causes no windup. An
obstacle that does not press on the transducer looks like friction, so the disturbance is limited.
While friction holds the handle with a tolerable force error, it stays as it is. Else the observer
would build up force until the handle breaks away and overshoots: hunting, as with any integral
action against stiction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from .limits import clamp
from .vertical_settings import VerticalSettings

KEPT = 12
"""Commands remembered; the observer models a delay of up to this number of periods less two."""
RESTING_WAY = 25e-6  # [m] more than two counts of the coarsest encoder (2 000 a turn)
RESTING_TIME = 0.1  # [s] in which a nut at rest goes no further


@dataclass(slots=True)
class Observer:
    """Estimated position [m] and velocity [m/s] of the nut, disturbance [N]; anchor: position from
    which the nut has not gone [m], for `stood` seconds; commands: those sent, newest first [N]."""

    position: float = 0.0
    velocity: float = 0.0
    disturbance: float = 0.0
    anchor: float = 0.0
    stood: float = RESTING_TIME
    commands: list[float] = field(default_factory=lambda: [0.0] * KEPT)


def settle(observer: Observer, position: float) -> None:
    """Put the observer to a nut at rest at a position [m], without a command."""
    observer.position, observer.velocity, observer.disturbance = position, 0.0, 0.0
    observer.anchor, observer.stood = position, RESTING_TIME
    for k in range(KEPT):
        observer.commands[k] = 0.0


def observe(
    p: VerticalSettings, observer: Observer, position: float, force: float, error: float, dt: float
) -> None:
    """Correct the estimates with a sample, dt [s] after the last one.

    position: measured [m]; force: known forces on the nut without the command: of the patient, less
    weight and foreseen friction [N]; error: of the force on the hand, filtered [N].
    """
    observer.stood += dt
    if abs(position - observer.anchor) > RESTING_WAY:
        observer.anchor, observer.stood = position, 0.0
    resting = observer.stood > RESTING_TIME and abs(error) < p.observer_rest
    acting = command_in_force(observer.commands, p.observer_delay / dt)
    acceleration = (acting + force - observer.disturbance) / p.mass
    ahead = observer.position + dt * (observer.velocity + 0.5 * dt * acceleration)
    off = position - ahead
    pole = math.exp(-p.observer_bandwidth * dt)
    left = 1.0 - pole
    rate = left / dt  # no dt squared below: the square of a tiny dt underflows to zero
    observer.position = ahead + (1.0 - pole * pole * pole) * off
    gained = 1.5 * left * rate * (1.0 + pole) * off
    observer.velocity = observer.velocity + dt * acceleration + gained
    disturbance = observer.disturbance
    if not resting:
        disturbance -= p.mass * left * rate * rate * off
    observer.disturbance = clamp(disturbance, -p.observer_limit, p.observer_limit)


def command_in_force(commands: list[float], periods: float) -> float:
    """Return the mean command over the last period [N]; periods: its delay in periods."""
    periods = clamp(periods, 0.0, KEPT - 2.0)
    whole = int(periods)
    part = periods - whole
    return (1.0 - part) * commands[whole] + part * commands[whole + 1]


def remember(observer: Observer, command: float) -> None:
    """Keep the command [N] that is sent now."""
    for k in range(KEPT - 1, 0, -1):
        observer.commands[k] = observer.commands[k - 1]
    observer.commands[0] = command
