# SPDX-License-Identifier: Apache-2.0
"""Backward difference and first-order Butterworth low-pass (thesis 3.3, 6.4.3), state passed in.

The thesis filters velocity and handle force at 30 Hz; the callers' settings hold these cutoffs
(`force_cutoff` in `control/vertical_settings.py`). The Butterworth filter is discretised by the
bilinear transform with prewarping, so its gain at the cutoff is -3 dB at any sample rate.
"""

from __future__ import annotations

import math
from typing import NamedTuple


class LowpassCoefficients(NamedTuple):
    """y[k] = feedback y[k-1] + gain (x[k] + x[k-1]); both numbers are dimensionless."""

    gain: float
    feedback: float


class LowpassState(NamedTuple):
    """Last input and last output, in the unit of the signal."""

    x: float
    y: float


class VelocityState(NamedTuple):
    """Last position [unit] and the filter of the velocity [unit/s]."""

    position: float
    lowpass: LowpassState


LONGEST_GAP = 10
"""Lost samples; after more of them the velocity restarts and is not filtered through the gap."""


def back_difference(previous: float, current: float, dt: float) -> float:
    """Return the rate of change [unit/s] over the last dt [s] (thesis eq 3.2)."""
    return (current - previous) / dt


def lowpass_coefficients(cutoff_hz: float, dt: float) -> LowpassCoefficients:
    """Return the filter for a cutoff [Hz] at a sample time dt [s].

    A cutoff above a quarter of the sample rate is clamped to it, the limit without overshoot: after
    lost samples dt is longer than the usual period.
    """
    warped = math.tan(math.pi * min(cutoff_hz * dt, 0.25))
    return LowpassCoefficients(warped / (1.0 + warped), (1.0 - warped) / (1.0 + warped))


def lowpass_settled(x: float) -> LowpassState:
    """Return the steady state of a filter with the constant input x."""
    return LowpassState(x, x)


def lowpass_step(
    coefficients: LowpassCoefficients, state: LowpassState, x: float
) -> tuple[float, LowpassState]:
    """Return the filtered value of x and the next state; one call per sample."""
    y = coefficients.feedback * state.y + coefficients.gain * (x + state.x)
    return y, LowpassState(x, y)


def velocity_settled(position: float) -> VelocityState:
    """Return the state at rest at `position` [unit]."""
    return VelocityState(position, lowpass_settled(0.0))


def velocity_step(
    coefficients: LowpassCoefficients,
    state: VelocityState,
    position: float,
    dt: float,
    periods: int = 1,
) -> tuple[float, VelocityState]:
    """Return the filtered velocity [unit/s] at the next position [unit] and the next state.

    dt: since the last position [s]; periods: sampling periods since then, 1 = no sample lost.
    """
    raw = back_difference(state.position, position, dt)
    if periods > LONGEST_GAP:
        return raw, VelocityState(position, lowpass_settled(raw))
    velocity, lowpass = raw, state.lowpass
    for _ in range(periods):
        velocity, lowpass = lowpass_step(coefficients, lowpass, raw)
    return velocity, VelocityState(position, lowpass)
