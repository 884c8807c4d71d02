# SPDX-License-Identifier: Apache-2.0
"""Smoothness of a speed profile: spectral arc length and dimensionless jerk.

SPARC and LDLJ as defined in balasubramanian2012 and balasubramanian2015 (docs/references.md). Both
are negative; a smoother movement is nearer to zero. Their values depend on the sampling rate, which
reports state.

The jerk is the third derivative of the way, in which the steps of the planar encoders (about 45 um
at the handle) outweigh any movement: of a minimum-jerk reach LDLJ was -12 in place of -4. So it is
computed from positions behind a low pass, `low_passed_speed`. SPARC has no derivative.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import butter, sosfiltfilt

SPARC_CUTOFF = 10.0
"""Highest frequency that counts [Hz] (2015)."""
SPARC_THRESHOLD = 0.05
"""Share of the largest magnitude below which the spectrum's end does not count (2015)."""
SPARC_PADDING = 4
"""Powers of two by which the profile is padded with zeros (2015)."""
JERK_CUTOFF = 6.0
"""Cut-off of the low pass in front of a derivative of the speed [Hz]; ours. It passes a reach of
0.5 s and the 4 to 6 Hz of a rest tremor; a faster tremor shows in SPARC alone. The tests tell with
which durations the encoders' steps do not matter."""
_ORDER = 4
"""Order of the Butterworth filter, once forward and once backward, so that nothing is delayed."""


def sparc(speed: ArrayLike, rate: float) -> float:
    """Return the spectral arc length of a speed profile [1].

    speed: samples of one movement [m/s]; rate: their number per second [Hz]. NaN for a profile
    without motion. Raises ValueError if the rate is not positive.
    """
    profile = _profile(speed, rate)
    if profile.size < 2 or not np.any(profile):
        return math.nan
    size = 2 ** (math.ceil(math.log2(profile.size)) + SPARC_PADDING)
    spectrum = np.abs(np.fft.fft(profile, size))
    frequencies = np.arange(size) * (rate / size)
    magnitude = (spectrum / spectrum.max())[frequencies <= SPARC_CUTOFF]
    frequencies = frequencies[frequencies <= SPARC_CUTOFF]
    counted = np.flatnonzero(magnitude >= SPARC_THRESHOLD)
    kept = slice(counted[0], counted[-1] + 1)
    frequencies, magnitude = frequencies[kept], magnitude[kept]
    if frequencies.size < 2:
        return math.nan
    band = frequencies[-1] - frequencies[0]
    return -float(np.sum(np.hypot(np.diff(frequencies) / band, np.diff(magnitude))))


def low_passed_speed(times: np.ndarray, path: np.ndarray) -> np.ndarray:
    """Return the speed [m/s] at as many even times, from positions behind the low pass.

    times [s], rising; path [m], shape (samples, axes). Butterworth of order 4 and `JERK_CUTOFF`,
    forward and backward: zero phase, -6 dB at the cut-off. Lost samples are interpolated. NaN if
    the sampling rate is too low for it.
    """
    count = len(times)
    rate = (count - 1) / (times[-1] - times[0]) if count > 1 and times[-1] > times[0] else 0.0
    if rate < 4.0 * JERK_CUTOFF:
        return np.full(count, math.nan)
    grid = np.linspace(times[0], times[-1], count)
    even = np.column_stack([np.interp(grid, times, axis) for axis in path.T])
    low_pass = butter(_ORDER, JERK_CUTOFF, fs=rate, output="sos")
    beyond = min(count - 1, round(rate / JERK_CUTOFF))
    smooth = sosfiltfilt(low_pass, even, axis=0, padlen=beyond)
    return np.linalg.norm(np.gradient(smooth, 1.0 / rate, axis=0), axis=1)


def dimensionless_jerk(speed: ArrayLike, rate: float) -> float:
    """Return the dimensionless jerk of a speed profile [1], negative.

    -(T^3 / vpeak^2) times the integral of (d2v/dt2)^2; the second derivative is the second
    difference. Arguments, NaN and errors as in `sparc`.
    """
    profile = _profile(speed, rate)
    if profile.size < 3 or not np.any(profile):
        return math.nan
    jerk = np.diff(profile, 2) * rate**2
    duration = profile.size / rate
    return -float(duration**3 / np.max(np.abs(profile)) ** 2 * np.sum(jerk**2) / rate)


def log_dimensionless_jerk(speed: ArrayLike, rate: float) -> float:
    """Return -ln |dimensionless jerk| [1]; arguments, NaN and errors as in `sparc`."""
    jerk = abs(dimensionless_jerk(speed, rate))
    return -math.log(jerk) if jerk > 0.0 else math.nan


def _profile(speed: ArrayLike, rate: float) -> np.ndarray:
    if not 0.0 < rate < math.inf:
        raise ValueError(f"rate = {rate!r} Hz: a positive number is wanted")
    profile = np.asarray(speed, dtype=float)
    if profile.ndim != 1 or not np.all(np.isfinite(profile)):
        raise ValueError("speed: one-dimensional and finite samples are wanted")
    return profile
