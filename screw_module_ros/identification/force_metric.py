# SPDX-License-Identifier: Apache-2.0
"""What a hand feels beside the impedance asked for: error over all samples, mass and friction felt.

The error is judged over all samples, with standstill and reversals (ours); the thesis's offset in
motion is in `offset.py`. All forces are those of the patient on the robot, up positive.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy import signal

RAPID = 30.0  # [Hz] above it: chatter; a hand and the crossings of the play are below
SWING = 3.0  # [Hz] above it, with a hand at rest: an oscillation
SHAKING = 1.5  # [N] rms over `WINDOW` of the force above SWING: unacceptable oscillation
WINDOW = 0.1  # [s]
CYCLES = 6
"""Last periods of a sine, over which its first harmonic is taken; two before them settle."""
_LARGEST = 0.04  # amplitude of a sine [m]
_LEAST_SINE = 0.5  # share of the motion's square that is the sine; 0.9 and more on the rig
LASTING = 0.5  # [s] window in which an oscillation that does not end is judged
LAST = 1.0  # [s] at the end of a trial, when the handle should be at rest


def apparent_mass(reactance: np.ndarray, frequencies: np.ndarray, stiffness: float) -> np.ndarray:
    """Return the mass [kg] that a reactance at the handle [Ns/m] shows beside a spring [N/m].

    frequencies: of the reactances [Hz].
    """
    omega = 2.0 * np.pi * frequencies
    return (reactance + stiffness / omega) / omega


def friction_felt(resistance: float, damping: float, speed: float) -> float:
    """Return the Coulomb friction [N] equivalent to a resistance [Ns/m] at the first harmonic.

    damping: the commanded part of the resistance [Ns/m]; speed: amplitude of the velocity [m/s]. A
    force F with the sign of the velocity has the first harmonic 4 F / pi.
    """
    return math.pi / 4.0 * (resistance - damping) * speed


def sine(hertz: float, speed: float, acceleration: float) -> tuple[float, float, float]:
    """Return amplitude [m], angular frequency [rad/s] and duration [s] of a hand's sine.

    speed [m/s], acceleration [m/s^2]: most of it.
    """
    omega = 2.0 * math.pi * hertz
    amplitude = min(_LARGEST, speed / omega, acceleration / omega**2)
    return amplitude, omega, (2 + CYCLES) / hertz + 0.5


def first_harmonic(
    time: np.ndarray, position: np.ndarray, force: np.ndarray, omega: float
) -> complex:
    """Return force over velocity of the handle [Ns/m] at `omega` [rad/s], over the last `CYCLES`.

    time [s], position [m] and force [N] are samples of the same instants. NaN if the handle did not
    follow the sine: force over a motion of other frequencies is no impedance.
    """
    count = round(2.0 * np.pi * CYCLES / omega / (time[1] - time[0]))
    turning = np.exp(-1j * omega * time[-count:])
    swing = position[-count:] - position[-count:].mean()
    moved = (turning * swing).sum()
    if not 2.0 * abs(moved) ** 2 >= _LEAST_SINE * len(swing) * (swing**2).sum() > 0.0:
        return complex(math.nan, math.nan)
    return complex((turning * force[-count:]).sum() / (1j * omega * moved))


class ErrorOf(NamedTuple):
    """Force error of one trial.

    mean: of the absolute value, rms, p99: 99th percentile of the absolute value, rapid: rms above
    `RAPID` [N]; swing: rms above `SWING` in the last second [N]; travel: of the handle in the last
    second [m]; share: remaining share of the force gain at the end, 0 to 1; shaking: the longest
    time for which the rms above `SWING` over a window stays above `SHAKING` [s].
    """

    mean: float
    rms: float
    p99: float
    rapid: float
    swing: float
    travel: float
    share: float
    shaking: float


def judged(
    period: float,
    position: np.ndarray,
    velocity: np.ndarray,
    force: np.ndarray,
    share: np.ndarray,
    stiffness: float,
    damping: float,
    first: int = 0,
) -> ErrorOf:
    """Return the error of samples `period` [s] apart, counted from the sample `first`.

    position: of the handle from the spring's centre [m], velocity [m/s], force: of the patient on
    the robot [N], share: of the force gain; stiffness [N/m], damping [Ns/m]: commanded. Raises
    ValueError for fewer samples than one second has.
    """
    last = round(LAST / period)
    if len(force) - first < last:
        raise ValueError(f"{len(force) - first} samples are judged: at least {last} are wanted")
    error = force - stiffness * position - damping * velocity
    kept = error[first:]
    return ErrorOf(
        mean=float(np.abs(kept).mean()),
        rms=_rms(kept),
        p99=float(np.percentile(np.abs(kept), 99.0)),
        rapid=_rms(above(RAPID, error, period)[first:]),
        swing=_rms(above(SWING, error, period)[-last:]),
        travel=float(np.ptp(position[-last:])),
        share=float(share[-1]),
        shaking=shaking(period, error, first),
    )


def above(corner: float, values: np.ndarray, period: float) -> np.ndarray:
    """Return what of samples `period` [s] apart lies above a corner [Hz], without a delay."""
    sections = signal.butter(4, corner, "high", fs=1.0 / period, output="sos")
    return signal.sosfiltfilt(sections, values, axis=0)


def lasting(period: float, error: np.ndarray, first: int) -> float:
    """Return the largest rms above `SWING` [N] over `LASTING`, from the sample `first` on.

    error: of samples `period` [s] apart, of one axis or a column for each [N]. What a cause has
    left a second after its end is an oscillation that feeds itself.
    """
    means = _means(_swinging(period, error, first), round(LASTING / period))
    return math.sqrt(max(means.max(), 0.0))


def _means(values: np.ndarray, window: int) -> np.ndarray:
    sums = np.cumsum(np.concatenate(([0.0], values)))
    return (sums[window:] - sums[:-window]) / window


def shaking(period: float, error: np.ndarray, first: int) -> float:
    """Return the longest time with a windowed rms above `SHAKING` [s], as `lasting` counts."""
    window = round(WINDOW / period)
    over = _means(_swinging(period, error, first), window) > SHAKING**2
    edges = np.flatnonzero(np.diff(np.concatenate(([0], over.astype(int), [0]))))
    return period * int((edges[1::2] - edges[::2]).max(initial=0))


def _swinging(period: float, error: np.ndarray, first: int) -> np.ndarray:
    """Return the squares of what lies above `SWING` [N^2], of all columns together."""
    return (above(SWING, error.reshape(len(error), -1), period)[first:] ** 2).sum(axis=1)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
