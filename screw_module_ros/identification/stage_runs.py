# SPDX-License-Identifier: Apache-2.0
"""Reduces one run of the positioning stage to force per bin of height (thesis 5.2.4).

An optimal (Parks-McClellan) low-pass of order 400 with a transition band of 30 Hz filters the force
one decade above the screw's rotation (fig 5-9); then it is averaged over bins of 2.5 mm. The 401
coefficients delay by a whole number of samples, which is corrected: force and position stay
synchronous. The stage's start (across the play and up to its speed) and its braking are removed
before the filter, so that they do not spread into the bins.
"""

from __future__ import annotations

import functools

import numpy as np
from scipy.signal import freqz, oaconvolve, remez

from ..geometry import Screw, counts_to_height
from .lab import Part
from .trials import Samples, StageTrial

BIN_MM = 2.5  # [mm] thesis: bin
BINS = 142  # thesis: bins
RANGE_MM = BIN_MM * BINS  # 355 mm
CENTRES_MM = BIN_MM * (np.arange(BINS) + 0.5)
ORDER = 400  # thesis: map_filter_points; at 2 kHz, the same length in time at other rates
DONT_CARE_HZ = 30.0  # [Hz] thesis: map_filter_band
SETTLE_S = 0.03  # three time constants of the load's lag, at steady speed
_DECADE = 10.0  # thesis: map_filter
_LOWEST_CUTOFF_HZ = 2.0  # narrower pass bands make the design singular, without a benefit
_RIPPLE = 1e-3  # largest gain error of a design in its bands
_SAME_LEAD, _NO_LEAD = 0.01, 0.6
"""Difference of speeds that a positioning stage never has, and one that no screw explains."""
_LEAST_SHARE = 0.3  # share of a bin's nominal samples; a bin with fewer counts as not measured
LOWER_HALF = CENTRES_MM < 0.5 * RANGE_MM


def turn_rate_hz(speed: float, screw: Screw) -> float:
    """Return the screw's rotation rate [Hz] at a speed [m/s] of the nut."""
    return abs(speed) / screw.lead


def lowpass_taps(speed: float, rate: float, screw: Screw) -> np.ndarray:
    """Return the filter's coefficients for a stage speed [m/s] and sample rate [1/s].

    Raises ValueError when the rate is too low for the speed.
    """
    cutoff = cutoff_hz(speed, screw)
    return optimal_lowpass(cutoff, cutoff + DONT_CARE_HZ, rate)


def cutoff_hz(speed: float, screw: Screw) -> float:
    """Return the filter's cutoff [Hz], a decade above the rotation rate at a stage speed [m/s]."""
    return max(_DECADE * turn_rate_hz(speed, screw), _LOWEST_CUTOFF_HZ)


@functools.lru_cache(maxsize=64)
def optimal_lowpass(cutoff: float, stop: float, rate: float) -> np.ndarray:
    """Return a symmetric Parks-McClellan low-pass with band edges `cutoff` and `stop` [Hz].

    Its order is 400 at 2 kHz, or a little less if the exchange algorithm does not converge because
    of rounding. Raises ValueError if the rate [1/s] is too low.
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
            return taps / taps.sum()  # unity gain at zero frequency
    raise ValueError(f"no low-pass from {cutoff:.3g} to {stop:.3g} Hz at {rate:g} samples a second")


def zero_phase(values: np.ndarray, taps: np.ndarray) -> np.ndarray:
    """Filter an array with a symmetric filter of odd length, without delay.

    The values are mirrored beyond the ends. Raises ValueError for fewer values than half the
    filter's length.
    """
    half = len(taps) // 2
    if len(values) <= half:
        raise ValueError(f"{len(values)} samples at constant speed: more than {half} are needed")
    return oaconvolve(np.pad(values, half, mode="reflect"), taps, mode="valid")


def steady_part(trial: StageTrial, samples: Samples, screw: Screw) -> slice:
    """Return the samples of a run in which the nut moves at the stage's speed.

    The reference is a line with the stage's speed through the middle half of the positions. The
    steady part stays within a few counts of it and begins `SETTLE_S` later. screw: for which the
    encoder is set.
    Raises ValueError if the nut does not move at the stage's speed; if it moves evenly at another
    one, the message names the lead that explains it.
    """
    time, position = samples.time, samples.position
    quarter = len(time) // 4
    middle = slice(quarter, len(time) - quarter)
    if quarter < 2:
        raise ValueError(f"{len(time)} samples of a run at {trial.speed:g} m/s: too few")
    behind = position - trial.speed * time
    behind = behind - behind[middle].mean()
    spread = behind[middle].std()
    allowed = 4.0 * spread + 2.0 * counts_to_height(1, screw)
    slope, shift = np.polyfit(time[middle], position[middle], 1)
    own = (position[middle] - slope * time[middle] - shift).std()
    if _SAME_LEAD < abs(slope / trial.speed - 1.0) < _NO_LEAD and own < 0.1 * spread:
        raise ValueError(
            f"the encoder shows {1e3 * slope:.4g} mm/s where the stage moves at "
            f"{1e3 * trial.speed:g} mm/s: the screw has a lead of "
            f"{1e3 * screw.lead * trial.speed / slope:.2f} mm, encoder and amplifier are set for "
            f"{1e3 * screw.lead:g} mm (parameter lead): every height and force is wrong by the "
            "ratio"
        )
    if spread > 0.5e-3:
        raise ValueError(
            f"the nut deviates by {spread * 1e3:.2g} mm from a motion at {trial.speed:g} m/s: is "
            "the stage coupled?"
        )
    off = np.abs(behind) > allowed
    before, after = np.flatnonzero(off[:quarter]), np.flatnonzero(off[-quarter:])
    begin = int(before[-1]) + 1 if len(before) else 0
    end = len(time) - quarter + int(after[0]) if len(after) else len(time)
    return slice(begin + round(SETTLE_S / period_of(samples)), end)


def period_of(samples: Samples) -> float:
    """Return the time between two samples [s]."""
    return float(samples.time[-1] - samples.time[0]) / (len(samples.time) - 1)


def binned(trial: StageTrial, samples: Samples, screw: Screw) -> Part:
    """Reduce a stage run to its bins; for `Lab.record`, with the bench's screw.

    Returns arrays of 142: `force` mean along z [N], NaN in a bin that was not measured; `count` of
    samples; `error` standard error of the mean from the sensor's noise [N].
    Raises ValueError without a steady part.
    """
    period = period_of(samples)
    steady = steady_part(trial, samples, screw)
    raw = samples.force[steady]
    smooth = zero_phase(raw, lowpass_taps(trial.speed, 1.0 / period, screw))
    place = np.floor(samples.position[steady] * (1e3 / BIN_MM)).astype(int)
    inside = (place >= 0) & (place < BINS)
    count = np.bincount(place[inside], minlength=BINS)
    total = np.bincount(place[inside], smooth[inside], minlength=BINS)
    whole = BIN_MM / 1e3 / abs(trial.speed) / period
    enough = count >= max(_LEAST_SHARE * whole, 1.0)
    force = np.where(enough, total / np.maximum(count, 1), np.nan)
    noise = float(1.4826 * np.median(np.abs(raw - smooth)))  # the median ignores steps
    error = np.where(enough, noise / np.sqrt(np.maximum(count, 1)), np.nan)
    return {
        "force": force,
        "count": np.where(enough, count, 0),
        "error": error,
    }


def stage_run(speed: float, low: float, high: float, upside_down: bool = False) -> StageTrial:
    """Return a run between two heights [m] at a speed [m/s], positive up the screw."""
    ends = (float(low), float(high)) if speed > 0.0 else (float(high), float(low))
    return StageTrial(speed, *ends, upside_down=upside_down)


def range_flaw(low: float, high: float, apart: float, why: str = "") -> str:
    """Return what is wrong unless `high` lies above `low` by `apart` [m], empty if nothing."""
    return "" if high - low >= apart else f"high must lie above low by {apart:g} m or more{why}"
