# SPDX-License-Identifier: Apache-2.0
"""Backward difference and first-order Butterworth filters (thesis 3.3, 6.4.3).

The thesis filters velocity and handle force at 30 Hz; the callers' settings hold these cutoffs
(`force_cutoff` in `control/vertical_settings.py`). The Butterworth filter is discretised by the
bilinear transform with prewarping, so its gain at the cutoff is -3 dB at any sample rate.

A law keeps its filters in its record: `Lowpass` and `Highpass`, tuned when the sample time changes.
The velocity of a sensor is a state that is passed in, because its sample time changes with each
lost sample.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple


class LowpassCoefficients(NamedTuple):
    """y[k] = feedback y[k-1] + gain (x[k] + x[k-1]); both numbers are dimensionless."""

    gain: float
    feedback: float


class VelocityState(NamedTuple):
    """Last position [unit], velocity before and behind the low pass [unit/s]."""

    position: float
    raw: float
    smooth: float


RECENT = 0.8
"""Time constant with which a largest recent size falls [s]."""
AT_REST = 1e-12
"""Filtered velocity of a position that no longer changes which counts as none [unit/s]: below it a
low pass only divides its last number, down to the smallest one of a float, where it stays."""
LONGEST_GAP = 10
"""Lost samples; after more of them the velocity restarts and is not filtered through the gap."""


def lowpass_coefficients(cutoff_hz: float, dt: float) -> LowpassCoefficients:
    """Return the filter for a cutoff [Hz] at a sample time dt [s].

    A cutoff above a quarter of the sample rate is clamped to it, the limit without overshoot: after
    lost samples dt is longer than the usual period.
    """
    warped = math.tan(math.pi * min(cutoff_hz * dt, 0.25))
    return LowpassCoefficients(warped / (1.0 + warped), (1.0 - warped) / (1.0 + warped))


@dataclass(slots=True)
class Lowpass:
    """A low pass: cutoff [Hz] and coefficients, from `tune`; last input x and last output y in the
    signal's unit."""

    cutoff: float = 0.0
    gain: float = 0.0
    feedback: float = 0.0
    x: float = 0.0
    y: float = 0.0


@dataclass(slots=True)
class Highpass:
    """Two low passes of one cutoff whose complements, in series, are a high pass."""

    first: Lowpass = field(default_factory=Lowpass)
    second: Lowpass = field(default_factory=Lowpass)


def tune(lowpass: Lowpass, cutoff_hz: float, dt: float) -> None:
    """Set the cutoff [Hz] for a sample time dt [s]; see `lowpass_coefficients`."""
    lowpass.cutoff = cutoff_hz
    lowpass.gain, lowpass.feedback = lowpass_coefficients(cutoff_hz, dt)


def tune_highpass(highpass: Highpass, cutoff_hz: float, dt: float) -> None:
    """Set the cutoff [Hz] of both stages for a sample time dt [s]."""
    tune(highpass.first, cutoff_hz, dt)
    tune(highpass.second, cutoff_hz, dt)


def smoothed(lowpass: Lowpass, x: float) -> float:
    """Return the low-passed value of x; one call per sample."""
    y = lowpass.feedback * lowpass.y + lowpass.gain * (x + lowpass.x)
    lowpass.x, lowpass.y = x, y
    return y


def derivative(lowpass: Lowpass, x: float) -> float:
    """Return the low-passed rate of change of x [unit/s]; one call per sample."""
    y = lowpass.feedback * lowpass.y + lowpass.gain * (x + lowpass.x)
    lowpass.x, lowpass.y = x, y
    return 2.0 * math.pi * lowpass.cutoff * (x - y)


def rapid(highpass: Highpass, x: float) -> float:
    """Return the part of x that is faster than the cutoff; one call per sample."""
    first, second = highpass.first, highpass.second  # two of `smoothed`, without its calls
    slow = first.feedback * first.y + first.gain * (x + first.x)
    first.x, first.y = x, slow
    fast = x - slow
    slower = second.feedback * second.y + second.gain * (fast + second.x)
    second.x, second.y = fast, slower
    return fast - slower


def clear(lowpass: Lowpass) -> None:
    """Forget the signal: as after a long input of zero."""
    lowpass.x, lowpass.y = 0.0, 0.0


def clear_highpass(highpass: Highpass) -> None:
    """Forget the signal of both stages."""
    clear(highpass.first)
    clear(highpass.second)


def envelope(largest: float, value: float, dt: float, recent: float = RECENT) -> float:
    """Return the largest recent size of a value, dt [s] after `largest`; both in its unit.

    recent: time constant with which it falls [s].
    """
    return max(abs(value), largest * math.exp(-dt / recent))


def velocity_settled(position: float) -> VelocityState:
    """Return the state at rest at `position` [unit]."""
    return VelocityState(position, 0.0, 0.0)


def velocity_step(
    coefficients: LowpassCoefficients,
    state: VelocityState,
    position: float,
    dt: float,
    periods: int = 1,
) -> tuple[float, VelocityState]:
    """Return the filtered velocity [unit/s] at the next position [unit] and the next state.

    The backward difference of eq 3.2 through the low pass. dt: since the last position [s];
    periods: sampling periods since then, 1 = no sample lost.
    """
    raw = (position - state.position) / dt
    if periods > LONGEST_GAP:
        return raw, VelocityState(position, raw, raw)
    before, smooth = state.raw, state.smooth
    for _ in range(periods):
        smooth = coefficients.feedback * smooth + coefficients.gain * (raw + before)
        before = raw
    if raw == 0.0 and -AT_REST < smooth < AT_REST:
        smooth = 0.0
    return smooth, VelocityState(position, raw, smooth)
