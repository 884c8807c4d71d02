# SPDX-License-Identifier: Apache-2.0
"""Spectrum of the force at constant speed: screw and rollers (thesis 5.2.4, figs 5-7 and 5-8)."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from scipy.signal import detrend, find_peaks, periodogram

from ..settings import Setting, validated
from .friction_bins import period_of, steady_part, turn_rate_hz
from .lab import Job, Lab, Part
from .results import Quantity, Result
from .trials import DIRECTIONS, Samples, StageTrial

NAME = "friction_spectrum"
ROLLERS = 4.0  # turns of a roller per turn of the screw: 14.2875 mm / 3.5 mm (5.2.4)
_MODES = (("screw", 1.0, "turn of the screw"), ("rollers", ROLLERS, "rollers"))
_LOWEST = 0.6  # of the screw's rate; below it is the trend along the screw
_HIGHEST = 6.0  # of the screw's rate; upper end of the search for modes
_ABOVE_FLOOR = 6.0  # least prominence of a mode over the noise floor


class Settings(NamedTuple):
    """Speed and range of the run."""

    speed: Annotated[float, Setting("of the stage", "m/s", 1e-3, 0.15)] = 0.020
    low: Annotated[float, Setting("lowest height of the handle", "m", 0.0, 0.2)] = 0.0
    high: Annotated[float, Setting("highest height of the handle", "m", 0.1, 0.36)] = 0.36


class Peak(NamedTuple):
    """A line of the spectrum: frequency [Hz], half of its width [Hz], amplitude [N]."""

    frequency: float
    width: float
    amplitude: float


def run(lab: Lab, settings: Settings) -> Result:
    """Find the modes, moving up and down.

    Data, per direction: `frequency_up` [Hz], `amplitude_up` [N]; `peaks_up` rows of `Peak`. Raises
    ValueError for inconsistent settings, and the errors of `Lab.run`.
    """
    validated(settings)
    if settings.high - settings.low < 0.08:
        raise ValueError("high must lie above low by 0.08 m or more: four turns of the screw")
    jobs = []
    for direction, sign in DIRECTIONS:
        ends = (float(settings.low), float(settings.high))[:: int(sign)]
        jobs.append(Job(direction, StageTrial(sign * float(settings.speed), *ends), spectrum))
    parts = lab.run(NAME, jobs)
    data, quantities, notes = {}, [], []
    turn = turn_rate_hz(settings.speed)
    for direction, _ in DIRECTIONS:
        frequency, amplitude = parts[direction]["frequency"], parts[direction]["amplitude"]
        found = modes(frequency, amplitude, turn)
        data[f"frequency_{direction}"], data[f"amplitude_{direction}"] = frequency, amplitude
        data[f"peaks_{direction}"] = np.array(found).reshape(-1, 3)
        for name, rate, what in _MODES:
            peak = nearest(found, rate * turn)
            if peak is None:
                notes.append(f"The spectrum has no line of the {what}, {direction}.")
                peak = Peak(*(float("nan"),) * 3)
            quantities += _of_peak(name, what, direction, peak, float(np.median(amplitude)))
    notes.append(
        "Amplitudes are means along the screw. A ripple whose amplitude or phase changes along the "
        "screw gives wider lines with less than its largest amplitude."
    )
    return Result(NAME, tuple(quantities), settings._asdict(), tuple(notes), data)


def spectrum(trial: StageTrial, samples: Samples) -> Part:
    """Reduce a run to `frequency` [Hz] and `amplitude` [N] of a sine, trend removed; for `Job`."""
    steady = steady_part(trial, samples)
    force = detrend(samples.force[steady.begin : steady.end])
    frequency, power = periodogram(
        force, fs=1.0 / period_of(samples), window="hann", scaling="spectrum"
    )
    return {"frequency": frequency, "amplitude": np.sqrt(2.0 * power)}


def modes(frequency: np.ndarray, amplitude: np.ndarray, turn: float) -> list[Peak]:
    """Return the lines near the screw's rate `turn` [Hz] and its low multiples.

    frequency [Hz], evenly spaced; amplitude [N].
    """
    step = float(frequency[1] - frequency[0])
    band = (frequency >= _LOWEST * turn) & (frequency <= _HIGHEST * turn)
    floor = float(np.median(amplitude[frequency > _HIGHEST * turn]))
    at, _ = find_peaks(
        np.where(band, amplitude, 0.0),
        prominence=_ABOVE_FLOOR * floor,
        distance=max(1, round(0.3 * turn / step)),
    )
    return [Peak(float(frequency[i]), step, float(amplitude[i])) for i in at]


def nearest(peaks: list[Peak], frequency: float) -> Peak | None:
    """Return the largest line within a tenth of a frequency [Hz], None without any."""
    near = [peak for peak in peaks if abs(peak.frequency - frequency) <= 0.1 * frequency]
    return max(near, key=lambda peak: peak.amplitude, default=None)


def _of_peak(name: str, what: str, direction: str, peak: Peak, floor: float) -> list[Quantity]:
    return [
        Quantity(
            f"{name}_{direction}", peak.frequency, peak.width, "Hz",
            f"frequency, {what}, {direction}",
        ),
        Quantity(
            f"{name}_force_{direction}", peak.amplitude, floor, "N",
            f"amplitude, {what}, {direction}",
        ),
    ]
