# SPDX-License-Identifier: Apache-2.0
"""From one run of the positioning stage to force per bin of height (thesis 5.2.4).

The force is low-passed one decade above the screw's rotation by an optimal (Parks-McClellan) filter
of order 400 with 30 Hz of "don't care" (fig 5-9), then averaged over bins of 2.5 mm. Order 400 is
401 coefficients, whose delay is a whole number of samples and is taken out: force and position stay
in step. What the stage does to get going, across the play and up to its speed, is left out before
the filter, so it is not smeared into the bins; what brakes it at the end likewise.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
from scipy.signal import freqz, oaconvolve, remez

from ..geometry import SCREW, counts_to_height
from .lab import Part
from .trials import Samples, StageTrial

BIN_MM = 2.5
BINS = 142
RANGE_MM = BIN_MM * BINS  # 355 mm, thesis 5.2.4
CENTRES_MM = BIN_MM * (np.arange(BINS) + 0.5)
ORDER = 400  # at the thesis's 2 kHz; the same length in time at other rates
DONT_CARE_HZ = 30.0
SETTLE_S = 0.03  # three time constants of what lags behind the load, after the speed is steady
_DECADE = 10.0
_LOWEST_CUTOFF_HZ = 2.0  # narrower pass bands make the design singular, and gain nothing
_RIPPLE = 1e-3  # the most a design may be off in its bands
_COUNT = counts_to_height(1)  # [m]
_LEAST_SHARE = 0.3  # of the samples a whole bin has: below, the bin counts as not measured


class Steady(NamedTuple):
    """The stretch of a run at constant speed: first and last sample [index], one behind the end."""

    begin: int
    end: int


def turn_rate_hz(speed: float) -> float:
    """Return how often the screw turns at a speed [m/s] of the nut [Hz]."""
    return abs(speed) / SCREW.lead


def lowpass_taps(speed: float, rate: float) -> np.ndarray:
    """Return the filter's coefficients for a stage speed [m/s] and sample rate [1/s].

    Raises ValueError when the rate is too low for the speed.
    """
    cutoff = cutoff_hz(speed)
    return optimal_lowpass(cutoff, cutoff + DONT_CARE_HZ, rate)


def cutoff_hz(speed: float) -> float:
    """Return the filter's cutoff for a stage speed [m/s]: a decade above the screw's turns [Hz]."""
    return max(_DECADE * turn_rate_hz(speed), _LOWEST_CUTOFF_HZ)


@functools.lru_cache(maxsize=64)
def optimal_lowpass(cutoff: float, stop: float, rate: float) -> np.ndarray:
    """Return a symmetric Parks-McClellan low-pass that passes to cutoff and stops from stop [Hz].

    Its order is 400 at 2 kHz; where the exchange does not converge because ripples would be lost
    in rounding, a little less. Raises ValueError when the rate [1/s] is too low.
    """
    if not 0.0 < cutoff < stop < 0.5 * rate:
        raise ValueError(
            f"{rate:g} samples per second are too few for a filter that stops from {stop:.3g} Hz"
        )
    longest = 2 * round(0.5 * ORDER * rate / 2000.0)
    for order in range(longest, longest // 2, -10):
        try:
            taps = remez(order + 1, [0.0, cutoff, stop, 0.5 * rate], [1.0, 0.0], fs=rate)
        except ValueError:
            continue
        frequency, gain = freqz(taps, worN=4096, fs=rate)
        wanted = np.where(frequency <= cutoff, 1.0, np.where(frequency >= stop, 0.0, np.nan))
        if np.nanmax(np.abs(np.abs(gain) - wanted)) < _RIPPLE:
            return taps / taps.sum()  # a mean force passes as it is
    raise ValueError(f"no low-pass from {cutoff:.3g} to {stop:.3g} Hz at {rate:g} samples a second")


def zero_phase(values: np.ndarray, taps: np.ndarray) -> np.ndarray:
    """Filter an array with a symmetric filter of odd length, its delay taken out.

    Beyond the ends the values are taken as mirrored. Raises ValueError when there are fewer values
    than half the filter.
    """
    half = len(taps) // 2
    if len(values) <= half:
        raise ValueError(f"{len(values)} samples at constant speed: more than {half} are needed")
    return oaconvolve(np.pad(values, half, mode="reflect"), taps, mode="valid")


def steady_part(trial: StageTrial, samples: Samples) -> Steady:
    """Find where the nut keeps pace with the stage.

    A line of the stage's speed is laid through the middle half of the positions. The steady stretch
    is what lies within a few counts of it, without `SETTLE_S` at its beginning.
    Raises ValueError when the nut does not move as the stage should.
    """
    time, position = samples.time, samples.position
    quarter = len(time) // 4
    middle = slice(quarter, len(time) - quarter)
    if quarter < 2:
        raise ValueError(f"{len(time)} samples of a run at {trial.speed:g} m/s: too few")
    behind = position - trial.speed * time
    behind = behind - behind[middle].mean()
    spread = behind[middle].std()
    allowed = 4.0 * spread + 2.0 * _COUNT
    if spread > 0.5e-3:
        raise ValueError(
            f"the nut strays {spread * 1e3:.2g} mm from {trial.speed:g} m/s: is the stage coupled?"
        )
    off = np.abs(behind) > allowed
    before, after = np.flatnonzero(off[:quarter]), np.flatnonzero(off[-quarter:])
    begin = int(before[-1]) + 1 if len(before) else 0
    end = len(time) - quarter + int(after[0]) if len(after) else len(time)
    return Steady(begin + round(SETTLE_S / period_of(samples)), end)


def period_of(samples: Samples) -> float:
    """Return the time between two samples [s]."""
    return float(samples.time[-1] - samples.time[0]) / (len(samples.time) - 1)


def binned(trial: StageTrial, samples: Samples) -> Part:
    """Reduce a stage run to its bins; for `Job`.

    Returns arrays of 142: `force` mean along z [N], NaN where the bin was not measured; `count`
    samples; `error` standard error of the mean by the sensor's noise [N]. `cutoff` [Hz].
    Raises ValueError when there is no steady stretch.
    """
    period = period_of(samples)
    steady = steady_part(trial, samples)
    raw = samples.force[steady.begin : steady.end]
    smooth = zero_phase(raw, lowpass_taps(trial.speed, 1.0 / period))
    place = np.floor(samples.position[steady.begin : steady.end] * (1e3 / BIN_MM)).astype(int)
    inside = (place >= 0) & (place < BINS)
    count = np.bincount(place[inside], minlength=BINS)
    total = np.bincount(place[inside], smooth[inside], minlength=BINS)
    whole = BIN_MM / 1e3 / abs(trial.speed) / period
    enough = count >= max(_LEAST_SHARE * whole, 1.0)
    force = np.where(enough, total / np.maximum(count, 1), np.nan)
    noise = float(1.4826 * np.median(np.abs(raw - smooth)))  # of a step, only the noise
    error = np.where(enough, noise / np.sqrt(np.maximum(count, 1)), np.nan)
    return {
        "force": force,
        "count": np.where(enough, count, 0),
        "error": error,
        "cutoff": np.array(cutoff_hz(trial.speed)),
    }
