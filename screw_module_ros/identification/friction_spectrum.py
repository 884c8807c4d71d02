# SPDX-License-Identifier: Apache-2.0
"""Spectrum of the force at constant speed: screw and rollers (thesis 5.2.4, figs 5-7 and 5-8)."""

from __future__ import annotations

from functools import partial
from typing import Annotated, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from scipy.signal import detrend, find_peaks, periodogram

from ..geometry import Screw
from ..settings import Setting
from .figures import COLOURS, axes_for, printed
from .lab import Lab, Part
from .results import STAGE, Drawn, Experiment, Published, Quantity, Result, beside
from .stage_runs import period_of, range_flaw, stage_run, steady_part, turn_rate_hz
from .trials import DIRECTIONS, Samples, StageTrial

NAME = "friction_spectrum"
THESIS = {
    "screw_up": Published("screw_peak", 0.05, given_to_plant=True),
    "rollers_up": Published("roller_peak", 0.1, given_to_plant=True),
}
ROLLERS = 4.0  # ours: turns of a roller per turn of the screw, 14.2875 / 3.5 mm rounded
_MODES = (("screw", 1.0, "turn of the screw"), ("rollers", ROLLERS, "rollers"))
_LOWEST = 0.6  # share of the screw's rate; below it is the trend along the screw
_HIGHEST = 6.0  # multiple of the screw's rate; upper end of the search for modes
_ABOVE_FLOOR = 6.0  # least prominence of a mode over the noise floor
_NEAR = 10.0  # end of fig 5-8 [Hz]
_FAR = 500.0  # end of fig 5-7 [Hz]


class Settings(NamedTuple):
    """Speed and range of the run."""

    speed: Annotated[
        float, Setting("of the stage", "m/s", 1e-3, 0.15)
    ] = 0.020  # thesis: spectrum_speed
    low: Annotated[float, Setting("lowest height of the handle", "m", 0.0, 0.2)] = 0.0
    high: Annotated[float, Setting("highest height of the handle", "m", 0.1, 0.36)] = 0.36

    def flaw(self) -> str:
        """Return what is wrong with too short a way."""
        return range_flaw(self.low, self.high, 0.08, ": four turns of the screw")


class Peak(NamedTuple):
    """A line of the spectrum: frequency [Hz], half of its width [Hz], amplitude [N]."""

    frequency: float
    width: float
    amplitude: float


def run(lab: Lab, settings: Settings) -> Result:
    """Find the modes, moving up and down.

    Data, per direction: `frequency_up` [Hz], `amplitude_up` [N]; `peaks_up` rows of `Peak`. Raises
    the errors of `Lab.record`.
    """
    trials = {
        direction: stage_run(sign * float(settings.speed), settings.low, settings.high)
        for direction, sign in DIRECTIONS
    }
    parts = lab.record(NAME, trials, partial(spectrum, screw=lab.stand.screw))
    data: dict[str, np.ndarray] = {}
    quantities, notes = [], []
    turn = turn_rate_hz(settings.speed, lab.stand.screw)
    for direction, _ in DIRECTIONS:
        frequency, amplitude = parts[direction]["frequency"], parts[direction]["amplitude"]
        found = modes(frequency, amplitude, turn)
        data |= {
            f"frequency_{direction}": frequency,
            f"amplitude_{direction}": amplitude,
            f"peaks_{direction}": np.array(found).reshape(-1, 3),
        }
        for name, rate, what in _MODES:
            peak = nearest(found, rate * turn)
            if peak is None:
                notes.append(f"The spectrum has no line of the {what}, {direction}.")
                peak = Peak(np.nan, np.nan, np.nan)
            quantities += [
                Quantity(f"{name}_{direction}", peak.frequency, peak.width, "Hz",
                         f"frequency, {what}, {direction}"),
                Quantity(f"{name}_force_{direction}", peak.amplitude, float(np.median(amplitude)),
                         "N", f"amplitude, {what}, {direction}"),
            ]  # fmt: skip
    notes.append(
        "Amplitudes are means along the screw. A ripple whose amplitude or phase changes along the "
        "screw gives wider lines with less than its largest amplitude."
    )
    return Result(NAME, beside(THESIS, quantities), settings._asdict(), tuple(notes), data)


def spectrum(trial: StageTrial, samples: Samples, screw: Screw) -> Part:
    """Reduce a run to `frequency` [Hz] and `amplitude` [N] of a sine, without trend."""
    force = detrend(samples.force[steady_part(trial, samples, screw)])
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


def draw(result: Result) -> Drawn:
    """Return figures 5-7 and 5-8, upward."""
    speed = result.settings["speed"] * 1e3
    return {
        "5-7": _spectrum(result, _FAR, f"Fig. 5-7: spectrum of the force, {speed:g} mm/s upward"),
        "5-8": _spectrum(result, _NEAR, f"Fig. 5-8: its lower end, {speed:g} mm/s upward"),
    }


def _spectrum(result: Result, upto: float, title: str) -> Figure:
    frequency, amplitude = result.data["frequency_up"], result.data["amplitude_up"]
    shown = frequency <= upto
    figure, axes = axes_for("frequency [Hz]", "amplitude of the force [N]", title)
    axes.plot(frequency[shown], amplitude[shown], color=COLOURS[0])
    axes.set_xlim(0.0, upto)
    if upto > _NEAR:  # the noise is not visible on a linear scale
        axes.set(yscale="log", ylim=(1e-5, None))
        return figure
    axes.set_ylim(bottom=0.0)
    peaks = [Peak(*row) for row in result.data["peaks_up"]]
    for name, _, text in _MODES:
        if peak := nearest(peaks, result.value(f"{name}_up")):
            axes.annotate(
                f"{text}, {peak.frequency:.2f} Hz, {peak.amplitude:.2f} N",
                (peak.frequency, peak.amplitude), xytext=(12, -4), textcoords="offset points",
                va="center",
            )  # fmt: skip
    printed(axes, [line.value for line in THESIS.values()], [0.0, 0.0], "frequencies, fig 5-8")
    axes.legend()
    return figure


EXPERIMENT = Experiment(
    NAME, "spectrum of the force at constant speed: screw and rollers (thesis 5.2.4)", Settings,
    run, draw, STAGE,
)  # fmt: skip
