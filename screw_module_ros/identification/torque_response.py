# SPDX-License-Identifier: Apache-2.0
"""Damping and delay of the locked rotor, and resolution of the delay (thesis 4.1.3, 4.1.4).

Figures 4-9 to 4-14. The rotor (J) on the transducer (K) has an undamped frequency of 3600 Hz, which
appears at 400 Hz in samples at 2 kHz.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, NamedTuple

import numpy as np

from ..settings import Setting
from .delay_limit import misfit_profile, wire_profile
from .lab import Lab
from .results import Quantity, Result
from .sampled_models import (
    Fit,
    continuous_response,
    first_order,
    fit_response,
    held_twice_response,
    sampled_response,
    second_order,
    series,
)
from .swept_sine import (
    Amplifier,
    Sweep,
    known_amplifier,
    measured_linearization,
    sweep_of,
    torque_jobs,
)
from .trials import TorqueTrial

NAME = "torque_response"
_STARTS = (0.3, 3.0, 10.0)  # initial damping [Nm s/rad]: the misfit can have several minima
_LIGHT = 0.005  # damping with a visible resonance [Nm s/rad]
_LOW, _HIGH = np.array([0.3, 0.01, 0.0]), np.array([3.0, 100.0, 4e-3])
_PROFILE = np.linspace(0.0, 1e-3, 101)


class Settings(NamedTuple):
    """The swept sine, and assumed parameters."""

    low: Annotated[float, Setting("lowest frequency", "Hz", 0.1, 1000.0)] = 1.0
    high: Annotated[float, Setting("highest frequency", "Hz", 1.0, 1000.0)] = 200.0
    count: Annotated[int, Setting("frequencies, evenly on a log scale", "", 4, 400)] = 40
    amplitude: Annotated[float, Setting("of the commanded torque, 2.2 A", "Nm", 0.05, 0.8)] = 0.352
    cycles: Annotated[int, Setting("cycles at each frequency", "", 1, 100)] = 4
    slow_rate: Annotated[
        float, Setting("second sampling rate (fig 4-12), 0 = none", "Hz", 0.0, 4000.0)
    ] = 1000.0
    stiffness: Annotated[float, Setting("K of the transducer", "Nm/rad", 10.0, 1e6)] = 10_000.0
    inertia: Annotated[float, Setting("J of the rotor", "kg m^2", 1e-7, 1e-2)] = 1.96e-5
    pole: Annotated[
        float, Setting("pole of the amplifier, if not measured", "Hz", 10.0, 1e5)
    ] = 1000.0
    delay: Annotated[
        float, Setting("delay of the amplifier, if not measured", "s", 0.0, 1e-3)
    ] = 60e-6


def run(lab: Lab, settings: Settings) -> Result:
    """Measure through the measured linearization, at both rates, and fit.

    Raises MissingResult without static_torque's result, Cancelled, NotPossible, ValueError.
    """
    frequencies = np.geomspace(settings.low, settings.high, settings.count)
    trial = TorqueTrial(0.0, settings.amplitude, 0.0, measured_linearization(lab))
    amplifier = known_amplifier(lab, settings.pole, settings.delay)
    rates = [(lab.rate, 0.0, "")]
    if settings.slow_rate and settings.slow_rate != lab.rate:
        rates.append((settings.slow_rate, settings.slow_rate, "_slow"))
    jobs = [
        torque_jobs(frequencies, trial._replace(rate=asked), settings.cycles, "torque")
        for _, asked, _ in rates
    ]
    parts = lab.run(NAME, sum(jobs, []))
    quantities: tuple[Quantity, ...] = ()
    data: dict[str, np.ndarray] = {}
    for (rate, _, end), own in zip(rates, jobs, strict=True):
        sweep = sweep_of({job.name: parts[job.name] for job in own})
        model = _model(sampled_response, settings, amplifier, frequencies, rate)
        fit = _fit(model, sweep)
        quantities += _found(fit, rate, end)
        data |= {
            f"frequency{end}": frequencies,
            f"measured{end}": sweep.values,
            f"error{end}": sweep.errors,
            f"model{end}": model(fit.values),
        }
        if not end:
            drawn = _model(held_twice_response, settings, amplifier, frequencies, rate)
            quantities += _drawn(_fit(drawn, sweep))
            data |= _limit(model, sweep, fit, rate, amplifier)
            data |= _folded(settings, amplifier, fit, rate)
    resonance = math.sqrt(settings.stiffness / settings.inertia) / (2.0 * math.pi)
    seen = abs(resonance - round(resonance / lab.rate) * lab.rate)
    quantities += (
        Quantity("resonance", resonance, math.nan, "Hz", "undamped, from K and J (thesis 3600 Hz)"),
        Quantity("resonance_seen", seen, math.nan, "Hz", "where it folds to (thesis 400 Hz)"),
    )
    notes = _notes(settings, amplifier, quantities, lab.rate)
    return Result(NAME, quantities, settings._asdict(), notes, data)


Model = Callable[[np.ndarray], np.ndarray]


def _model(
    kind: Callable, settings: Settings, amplifier: Amplifier, frequencies: np.ndarray, rate: float
) -> Model:
    """Return the response as a function of gain, damping [Nm s/rad] and software delay [s]."""

    def model(numbers: np.ndarray) -> np.ndarray:
        gain, damping, delay = numbers
        rotor = second_order(settings.inertia, damping, settings.stiffness)
        chain = series(first_order(amplifier.pole), rotor)
        return gain * kind(chain, frequencies, rate, amplifier.delay + delay)

    return model


def _fit(model: Model, sweep: Sweep) -> Fit:
    fits = [
        fit_response(model, sweep.values, (1.0, damping, 3e-4), _LOW, _HIGH) for damping in _STARTS
    ]
    return min(fits, key=lambda fit: fit.misfit)


def _found(fit: Fit, rate: float, end: str) -> tuple[Quantity, ...]:
    gain, damping, delay = map(float, fit.values)
    gain_error, damping_error, delay_error = map(float, fit.errors)
    at = f"at {rate:g} Hz"
    return (
        Quantity(f"damping{end}", damping, damping_error, "Nm s/rad",
                 f"B of C.3, {at} (thesis 7.2)"),
        Quantity(f"delay{end}", delay, delay_error, "s",
                 f"software delay, {at} (thesis 400 us, direct study 200 to 450 us)"),
        Quantity(f"gain{end}", gain, gain_error, "", f"torque per desired torque, {at}"),
        Quantity(f"misfit{end}", fit.misfit, math.nan, "",
                 f"rms of model over measured, less 1, {at}"),
    )  # fmt: skip


def _drawn(fit: Fit) -> tuple[Quantity, ...]:
    return (
        Quantity("damping_two_holds", float(fit.values[1]), float(fit.errors[1]), "Nm s/rad",
                 "B if the A/D card is drawn as a hold, as in the thesis's fig C-1"),
        Quantity("delay_two_holds", float(fit.values[2]), float(fit.errors[2]), "s",
                 "software delay with that model"),
        Quantity("misfit_two_holds", fit.misfit, math.nan, "", "rms with that model"),
    )  # fmt: skip


def _limit(
    model: Model, sweep: Sweep, fit: Fit, rate: float, amplifier: Amplifier
) -> dict[str, np.ndarray]:
    """Return the misfit over the delay: with the rotor's dynamics, and for a wire."""
    gain, damping, delay = fit.values
    total = float(amplifier.delay + delay)
    return {
        "limit_delay": _PROFILE,
        "limit_rotor": misfit_profile(
            model, sweep.values, _PROFILE, fit.values[:2], _LOW[:2], _HIGH[:2]
        ),
        "limit_wire": wire_profile(sweep.frequencies, rate, total, _PROFILE + amplifier.delay),
    }


def _folded(
    settings: Settings, amplifier: Amplifier, fit: Fit, rate: float
) -> dict[str, np.ndarray]:
    """Return responses of the rotor with light and with identified damping, sampled and not."""
    frequencies = np.linspace(5.0, 0.4999 * rate, 800)
    wide = np.linspace(5.0, 2.5 * rate, 2000)
    amplifier_pole = first_order(amplifier.pole)
    light = series(amplifier_pole, second_order(settings.inertia, _LIGHT, settings.stiffness))
    heavy = series(
        amplifier_pole, second_order(settings.inertia, float(fit.values[1]), settings.stiffness)
    )
    delay = float(fit.values[2]) + amplifier.delay
    return {
        "folded_frequency": frequencies,
        "folded_light": sampled_response(light, frequencies, rate, delay),
        "folded_found": sampled_response(heavy, frequencies, rate, delay),
        "wide_frequency": wide,
        "wide_light": continuous_response(light, wide, delay),
        "light_damping": np.array(_LIGHT),
    }


def _notes(
    settings: Settings, amplifier: Amplifier, quantities: tuple[Quantity, ...], rate: float
) -> tuple[str, ...]:
    found = {quantity.name: quantity for quantity in quantities}
    damping, delay = found["damping"], found["delay"]
    ratio = damping.value / (2.0 * math.sqrt(settings.stiffness * settings.inertia))
    corner = settings.stiffness / damping.value / (2.0 * math.pi)
    half = 0.5 / rate
    return (
        amplifier.note,
        f"B = {damping.value:.3g} Nm s/rad is a damping ratio of {ratio:.1f}. "
        + (
            f"The mode is overdamped: its slow pole K/B at {corner:.0f} Hz lowers magnitude and "
            "phase, without a resonance. A figure shows the alias of a lightly damped resonance."
            if ratio > 1.0
            else "The mode resonates; the samples show an alias of the resonance."
        ),
        "In the samples of a wire, a delay shorter than a sample is not visible (4.1.4). With "
        f"known dynamics it is: the standard error here is {1e6 * delay.uncertainty:.1f} us, and "
        "an error of 5 % of the amplifier's pole would shift the delay by "
        f"{0.05e6 / (2.0 * math.pi * amplifier.pole):.0f} us. The thesis's limit applies to a "
        "plant without dynamics, not to sampled data in general.",
        f"With a second hold for the A/D card (fig C-1) the model lags {1e6 * half:.0f} us more, "
        "and the fitted delay is shorter.",
    )
