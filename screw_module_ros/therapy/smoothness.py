# SPDX-License-Identifier: Apache-2.0
"""Smoothness of a speed profile: spectral arc length and dimensionless jerk.

SPARC and LDLJ as defined in balasubramanian2012 and balasubramanian2015 (docs/references.md). Both
are negative; a smoother movement is nearer to zero. Their values depend on the sampling rate, which
reports state.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

SPARC_CUTOFF = 10.0
"""Highest frequency that counts [Hz] (2015)."""
SPARC_THRESHOLD = 0.05
"""Share of the largest magnitude below which the spectrum's end does not count (2015)."""
SPARC_PADDING = 4
"""Powers of two by which the profile is padded with zeros (2015)."""


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
