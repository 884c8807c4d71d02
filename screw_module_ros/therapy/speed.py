# SPDX-License-Identifier: Apache-2.0
"""Metrics of a speed profile: begin and end of the movement, peaks, arrests."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.signal import find_peaks

MOVING_SHARE = 0.1
"""Share of the peak speed above which the hand counts as moving, as in most reports about robots of
this family."""
SHORTEST = 0.1
"""Least duration of a movement [s]."""
SLOWEST = 0.01
"""Least peak speed of a movement [m/s]."""
PEAK_PROMINENCE = 0.05
"""Least prominence of a speed peak, as a share of the peak speed; ours: velocities are noisy."""


class SpeedFigures(NamedTuple):
    """mean, peak [m/s]; ratio: mean over peak; duration [s]; peaks: number; arrest: MAPR.

    arrest: share of the movement's time above a tenth of the peak speed (movement arrest period
    ratio, Rohrer et al., J. Neurosci. 22:8297, 2002).
    """

    mean: float
    peak: float
    ratio: float
    duration: float
    peaks: int
    arrest: float


def movement(speed: np.ndarray, rate: float) -> slice | None:
    """Return the samples of the movement: from the first to the last above a tenth of the peak.

    speed [m/s], rate [Hz]. None without a movement: shorter than 0.1 s or peak below 0.01 m/s.
    """
    if speed.size == 0:
        return None
    peak = float(speed.max())
    above = np.flatnonzero(speed > MOVING_SHARE * peak)
    if peak < SLOWEST or above.size == 0:
        return None
    found = slice(int(above[0]), int(above[-1]) + 1)
    return found if (found.stop - found.start) / rate >= SHORTEST else None


def speed_figures(speed: np.ndarray, rate: float) -> SpeedFigures:
    """Return the figures of one movement's speed [m/s] at a rate [Hz]; at least one sample."""
    peak = float(speed.max())
    padded = np.concatenate(([0.0], speed, [0.0]))  # a profile may begin or end at a peak
    found, _ = find_peaks(padded, prominence=PEAK_PROMINENCE * peak)
    mean = float(speed.mean())
    return SpeedFigures(
        mean=mean,
        peak=peak,
        ratio=mean / peak if peak > 0.0 else math.nan,
        duration=speed.size / rate,
        peaks=len(found),
        arrest=float(np.mean(speed > MOVING_SHARE * peak)),
    )
