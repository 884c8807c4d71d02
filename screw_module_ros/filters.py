# SPDX-License-Identifier: Apache-2.0
"""Back difference and first-order Butterworth low-pass (thesis 3.3, 6.4.3), state passed in.

The thesis filters velocity and handle force at 30 Hz. The Butterworth filter is discretised by the
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


def back_difference(previous: float, current: float, dt: float) -> float:
    """Return the rate of change [unit/s] over the last dt [s] (thesis eq 3.2)."""
    return (current - previous) / dt


def lowpass_coefficients(cutoff_hz: float, dt: float) -> LowpassCoefficients:
    """Return the filter for a cutoff [Hz] at a sample time dt [s].

    A cutoff above a quarter of the sample rate is held there, where the filter just does not
    overshoot yet: after lost samples dt is longer than the usual period.
    """
    warped = math.tan(math.pi * min(cutoff_hz * dt, 0.25))
    return LowpassCoefficients(warped / (1.0 + warped), (1.0 - warped) / (1.0 + warped))


def lowpass_settled(x: float) -> LowpassState:
    """Return the state of a filter that has seen the constant input x for ever."""
    return LowpassState(x, x)


def lowpass_step(
    coefficients: LowpassCoefficients, state: LowpassState, x: float
) -> tuple[float, LowpassState]:
    """Return the filtered value of x and the next state; one call per sample."""
    y = coefficients.feedback * state.y + coefficients.gain * (x + state.x)
    return y, LowpassState(x, y)
