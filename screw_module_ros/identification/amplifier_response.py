# SPDX-License-Identifier: Apache-2.0
"""Pole and delay of the servo amplifier, with a signal analyser (thesis 4.1.2, figs 4-5, 4-6)."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from ..settings import Setting
from .figures import bode
from .lab import Lab, Part
from .results import ANALYZER, Drawn, Experiment, Published, Quantity, Result, beside
from .sampled import (
    first_order,
    fit_response,
    model_of,
    response_part,
    sampled_response,
    sweep_of,
    whole_cycles,
)
from .trials import AnalyzerTrial, Samples

NAME = "amplifier_response"
THESIS = {
    "pole": Published("amplifier_pole", 50.0, given_to_plant=True),
    "delay": Published("amplifier_delay", 5e-6, given_to_plant=True),
}
_SETTLE_S = 0.01
_START, _LOW, _HIGH = (1.0, 500.0, 3e-5), (0.1, 20.0, 0.0), (10.0, 2e4, 1e-3)


class Settings(NamedTuple):
    """The swept sine."""

    low: Annotated[
        float, Setting("lowest frequency", "Hz", 0.1, 1000.0)
    ] = 1.0  # thesis: analyser_sweep[0]
    high: Annotated[
        float, Setting("highest frequency", "Hz", 10.0, 5e4)
    ] = 10_000.0  # thesis: analyser_sweep[1]
    per_decade: Annotated[int, Setting("frequencies per decade", "", 2, 200)] = 40
    amplitude: Annotated[
        float, Setting("amplitude of the command", "A", 0.1, 10.0)
    ] = 2.2  # ours: that of 4.1.3; 4.1.2 prints none
    cycles: Annotated[int, Setting("cycles at each frequency", "", 1, 100)] = 2
    shortest: Annotated[float, Setting("least duration of each sine", "s", 0.005, 10.0)] = 0.04

    def flaw(self) -> str:
        """Return what is wrong with a sweep without a width."""
        wrong = f"high = {self.high:g} Hz is not above low = {self.low:g} Hz"
        return wrong if self.high <= self.low else ""


def run(lab: Lab, settings: Settings) -> Result:
    """Measure and fit. Raises Cancelled, NotPossible without an analyser, ValueError."""
    count = round(settings.per_decade * math.log10(settings.high / settings.low)) + 1
    frequencies = np.geomspace(settings.low, settings.high, count)
    trials = {
        f"{number:03d}": AnalyzerTrial(
            frequency, settings.amplitude,
            _SETTLE_S + whole_cycles(frequency, settings.cycles, settings.shortest),
        )
        for number, frequency in enumerate(frequencies.tolist())
    }  # fmt: skip
    measured, errors = sweep_of(lab.record(NAME, trials, reduced))
    model = model_of(sampled_response, first_order, frequencies, _RATE)
    fit = fit_response(model, measured, _START, _LOW, _HIGH)
    quantities = (
        fit.quantity(1, "pole", "Hz", "first-order pole"),
        fit.quantity(2, "delay", "s", "pure delay"),
        fit.quantity(0, "gain", "", f"at {settings.amplitude:g} A of command"),
        Quantity("misfit", fit.misfit, math.nan, "", "rms of model over measured, less 1"),
    )
    data = {
        "frequency": frequencies,
        "measured": measured,
        "error": errors,
        "model": model(fit.values),
    }
    return Result(NAME, beside(THESIS, quantities), settings._asdict(), _NOTES, data)


_RATE = AnalyzerTrial(1.0, 1.0, 1.0).rate
_NOTES = (
    "The dead zone, which takes the same current at any amplitude, makes the gain smaller than "
    "1. It does not shift the phase, so pole and delay are unaffected. Thesis 4.1.2 has none.",
    f"The analyser holds its output for one sample, {1e6 / _RATE:.3g} us, as in the model.",
    "The standard error of a point treats the dead zone's harmonics as noise. The simulated "
    "analyser has no noise; its agreement says nothing about a real instrument.",
)


def reduced(trial: AnalyzerTrial, samples: Samples) -> Part:
    """Return the response of current to command after the first 10 ms."""
    return response_part(trial.frequency, samples.time, samples.command, samples.current, _SETTLE_S)


def draw(result: Result) -> Drawn:
    """Return figs 4-5 and 4-6."""
    d = result.data
    pole, delay = (THESIS[name].value for name in ("pole", "delay"))
    models = {
        f"model: {result.value('pole'):.4g} Hz, {1e6 * result.value('delay'):.3g} us": d["model"],
        f"as the thesis prints it: {pole:g} Hz, {1e6 * delay:g} us": result.value("gain")
        * sampled_response(first_order(pole), d["frequency"], _RATE, delay),
    }
    measured = (d["frequency"], d["measured"])
    return {
        "4-5": bode("Fig. 4-5: amplifier, current / commanded current", *measured),
        "4-6": bode("Fig. 4-6: amplifier, with fitted model", *measured, models),
    }


EXPERIMENT = Experiment(
    NAME, "pole and delay of the servo amplifier, with a signal analyser (thesis 4.1.2)", Settings,
    run, draw, ANALYZER,
)  # fmt: skip
