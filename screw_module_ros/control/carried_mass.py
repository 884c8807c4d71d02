# SPDX-License-Identifier: Apache-2.0
"""Mass that OBSERVER carries for the hand, beyond what its force gain takes away (thesis 6.4.3).

A force gain k leaves the hand with M / (1 + k), which is most of what it feels in fast motion. With
the mass known from a calibration (thesis 5.3), a share of that remainder is accelerated for the
hand: a force of share M / (1 + k) times the estimated acceleration joins spring and damper.

Positive feedback of an acceleration needs two bounds. A share of a mass that is too large would
leave less than none, so the share is for a mass that was measured. And the filter's lag turns a
part of the force into a negative damper, which swings a handle that nobody holds: the force comes
in with the hand's, so that a free handle has none of it.
"""

from __future__ import annotations

import math

from ..filters import LowpassState, lowpass_coefficients, lowpass_step

CUTOFF = 6.0
"""Corner of the acceleration's filter [Hz]: above it the hand feels M / (1 + k) again."""
KNOWN_SHARE = 0.7
"""Of the mass that is left, to carry where a calibration measured it: a mass 40 % too large leaves
none."""
FIRM = 1.0
"""Force of the hand on the handle from which all of the share is in [N]."""


def carried_step(
    state: LowpassState,
    velocity: float,
    mass: float,
    gain: float,
    handle_force: float,
    dt: float,
) -> tuple[float, LowpassState]:
    """Return the force in the direction of the acceleration [N], and the next state.

    state: low pass of the velocity; velocity: estimated [m/s]; mass: share of M to carry [kg];
    gain: k; handle_force: patient on robot, filtered [N]; dt [s].
    """
    slow, state = lowpass_step(lowpass_coefficients(CUTOFF, dt), state, velocity)
    acceleration = 2.0 * math.pi * CUTOFF * (velocity - slow)
    held = min(1.0, abs(handle_force) / FIRM)
    return held * mass / (1.0 + gain) * acceleration, state
