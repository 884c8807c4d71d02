# SPDX-License-Identifier: Apache-2.0
"""Software delay from command to motor current, sampled at 2 kHz (thesis 4.1.2, figs 4-7, 4-8)."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from ..settings import Setting
from .figures import bode
from .lab import Lab
from .results import LOCKED_ROTOR, Drawn, Experiment, Published, Quantity, Result, beside
from .sampled import (
    current_part,
    current_sensor,
    first_order,
    fit_response,
    held_twice_response,
    known_amplifier,
    model_of,
    sampled_response,
    series,
    sweep_of,
    torque_sweep,
)
from .static_torque import measured_linearization
from .trials import TorqueTrial
from .uncertainty import bounded

NAME = "current_response"
DELAY_WHY = (
    "the loop in process has the 325 us of Table 3.1; the thesis found 150, 254, 325 and 400 us by "
    "four methods, and states that less than a sample (500 us) cannot be resolved"
)
THESIS = {
    "delay": Published("software_delay_current", 250e-6, DELAY_WHY, given_to_plant=True),
}
_PARTS = "parts of the current sensor, which delays by 198 us, within 5 %", 0.05 * 198e-6


class Settings(NamedTuple):
    """The swept sine, and assumed parameters."""

    low: Annotated[float, Setting("lowest frequency", "Hz", 0.1, 1000.0)] = 1.0  # thesis: sweep[0]
    high: Annotated[
        float, Setting("highest frequency", "Hz", 1.0, 1000.0)
    ] = 200.0  # thesis: sweep[1]
    count: Annotated[
        int, Setting("frequencies, evenly on a log scale", "", 4, 400)
    ] = 40  # type: ignore[assignment]  # hides the tuple's method
    amplitude: Annotated[
        float, Setting("of the commanded torque, 2.2 A", "Nm", 0.05, 0.8)
    ] = 0.352  # ours: sweep_current times torque_constant
    cycles: Annotated[int, Setting("cycles at each frequency", "", 1, 100)] = 4
    torque_constant: Annotated[
        float, Setting("published torque constant: command to current", "Nm/A", 1e-3, 10.0)
    ] = 0.16  # thesis: torque_constant
    pole: Annotated[
        float, Setting("pole of the amplifier, if not measured", "Hz", 10.0, 1e5)
    ] = 1000.0  # thesis: amplifier_pole
    delay: Annotated[
        float, Setting("delay of the amplifier, if not measured", "s", 0.0, 1e-3)
    ] = 60e-6  # thesis: amplifier_delay


def run(lab: Lab, settings: Settings) -> Result:
    """Measure through the measured linearization and fit.

    Raises MissingResult without static_torque's result, Cancelled, NotPossible, ValueError.
    """
    frequencies = np.geomspace(settings.low, settings.high, settings.count)
    trial = TorqueTrial(0.0, settings.amplitude, 0.0, measured_linearization(lab))
    trials = torque_sweep(frequencies, trial, settings.cycles, "current")
    values, errors = sweep_of(lab.record(NAME, trials, current_part))
    amplifier = known_amplifier(lab, settings.pole, settings.delay)
    chain = series(first_order(amplifier.pole), current_sensor())
    per_ampere = settings.torque_constant / chain.gain  # V/Nm to amperes seen per ampere commanded
    measured = values * per_ampere
    chain = chain._replace(gain=1.0)
    exact, drawn = (
        model_of(kind, lambda: chain, frequencies, lab.rate, amplifier.delay)
        for kind in (sampled_response, held_twice_response)
    )
    fit = fit_response(exact, measured, (1.0, 2e-4), (0.1, 0.0), (10.0, 4.0 / lab.rate))
    other = fit_response(drawn, measured, (1.0, 2e-4), (0.1, -1e-3), (10.0, 4.0 / lab.rate))
    quantities = (
        fit.quantity(1, "delay", "s",
                     "software delay, from a sample to the command that answers it",
                     *amplifier.sources, *lab.real(bounded(*_PARTS))),
        fit.quantity(0, "gain", "", "current per commanded current"),
        Quantity("misfit", fit.misfit, math.nan, "", "rms of model over measured, less 1"),
        other.quantity(
            1, "delay_two_holds", "s",
            "software delay if the A/D card is drawn as a hold, as in the thesis's fig C-1",
        ),
        Quantity("misfit_two_holds", other.misfit, math.nan, "", "rms with that model"),
    )  # fmt: skip
    data = {
        "frequency": frequencies,
        "measured": measured,
        "error": errors * abs(per_ampere),
        "model": exact(fit.values),
        "model_no_delay": exact(np.array([fit.values[0], 0.0])),
    }
    notes = (
        amplifier.note,
        "The model is exact for held commands and instantaneous samples. With a second hold for "
        f"the A/D card (fig C-1) it lags {0.5e6 / lab.rate:.0f} us more, and the fitted delay is "
        "shorter by the same time. The thesis's 150 us here and 400 us from the torque differ by "
        "as much.",
        "The simulated current has the steps of its A/D card, but neither noise nor 60 Hz hum: no "
        "band-stop filter is used, and the standard errors are smaller than in a laboratory.",
    )
    return Result(NAME, beside(THESIS, quantities), settings._asdict(), notes, data)


def draw(result: Result) -> Drawn:
    """Return figs 4-7 and 4-8."""
    d = result.data
    models = {
        f"model, software delay {1e6 * result.value('delay'):.0f} us": d["model"],
        "model without software delay": d["model_no_delay"],
    }
    measured = (d["frequency"], d["measured"])
    return {
        "4-7": bode("Fig. 4-7: current / commanded current, 2 kHz", *measured),
        "4-8": bode("Fig. 4-8: current / commanded current, 2 kHz, with model", *measured, models),
    }


EXPERIMENT = Experiment(
    NAME, "software delay from command to motor current, sampled at 2 kHz (thesis 4.1.2)", Settings,
    run, draw, LOCKED_ROTOR, ("static_torque",),
)  # fmt: skip
