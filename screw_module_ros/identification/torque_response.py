# SPDX-License-Identifier: Apache-2.0
"""Damping and delay of the locked rotor, and resolution of the delay (thesis 4.1.3, 4.1.4).

Figures 4-9 to 4-14. The rotor (J) on the transducer (K) has an undamped frequency of 3600 Hz, which
appears at 400 Hz in samples at 2 kHz.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..settings import Setting
from .current_response import DELAY_WHY
from .figures import COLOURS, DESIRED, axes_for, bode, decibels, phase_degrees
from .lab import Lab
from .results import (
    DERIVED,
    LOCKED_ROTOR,
    MEASURED,
    Drawn,
    Experiment,
    Published,
    Quantity,
    Result,
    beside,
    from_sources,
)
from .sampled import (
    WIRE,
    Chain,
    Fit,
    Model,
    continuous_response,
    first_order,
    fit_response,
    held_twice_response,
    known_amplifier,
    model_of,
    sampled_response,
    second_order,
    series,
    sweep_of,
    torque_part,
    torque_sweep,
)
from .static_torque import measured_linearization
from .trials import TorqueTrial
from .uncertainty import bounded

NAME = "torque_response"
THESIS = {
    "damping": Published("rotor_damping", 0.7, given_to_plant=True),
    "delay": Published("software_delay_torque", 250e-6, DELAY_WHY, given_to_plant=True),
    "resonance": Published("rotor_resonance", 50.0),
    "resonance_seen": Published("rotor_resonance_alias", 50.0),
}
_FIRST, _SECOND, _THIRD = COLOURS[:3]
_STIFFNESS = "stiffness of the transducer about z, from its data sheet, within 5 %"
_EARLY = (15.0, 60.0)  # [Hz] where no delay turns the phase by half a turn
_STARTS = (0.3, 3.0, 10.0)  # initial damping [Nm s/rad]: the misfit can have several minima
_LIGHT = 0.005  # damping with a visible resonance [Nm s/rad]
_LOW, _HIGH = np.array([0.3, 0.01, 0.0]), np.array([3.0, 100.0, 4e-3])
_PROFILE = np.linspace(0.0, 1e-3, 101)


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
    pole, late = amplifier.pole, amplifier.delay
    rates = {"": 0.0}  # asked for, 0 = the bench's own
    if settings.slow_rate not in (0.0, lab.rate):
        rates["_slow"] = settings.slow_rate
    sweeps = {
        end: torque_sweep(frequencies, trial._replace(rate=asked), settings.cycles, "torque")
        for end, asked in rates.items()
    }
    parts = lab.record(NAME, {**sweeps[""], **sweeps.get("_slow", {})}, torque_part)

    def chain(damping: float) -> Chain:
        rotor = second_order(settings.inertia, damping, settings.stiffness)
        return series(first_order(pole), rotor)

    quantities: tuple[Quantity, ...] = ()
    data: dict[str, np.ndarray] = {}
    for end, own in sweeps.items():
        rate = rates[end] or lab.rate
        measured, errors = sweep_of({name: parts[name] for name in own})
        model = model_of(sampled_response, chain, frequencies, rate, late)
        lag = late + 0.5 / (math.pi * pole)
        begun = _delay_seen(frequencies, measured, lag + 0.5 / rate)
        fit, at = _fit(model, measured, begun), f"at {rate:g} Hz"
        quantities += (
            fit.quantity(1, f"damping{end}", "Nm s/rad", f"B of C.3, {at}",
                         *lab.real(bounded(_STIFFNESS, 0.05 * float(fit.values[1])))),
            fit.quantity(2, f"delay{end}", "s",
                         f"software delay, {at} (direct study 200 to 450 us)", *amplifier.sources),
            fit.quantity(0, f"gain{end}", "", f"torque per desired torque, {at}"),
            from_sources(f"loop_delay{end}", float(fit.values[2]) + lag,
                         (fit.scatter[2], *amplifier.sources[:1]), "s",
                         f"from a sample to its force, amplifier included, {at}"),
            Quantity(f"misfit{end}", fit.misfit, math.nan, "",
                     f"rms of model over measured, less 1, {at}"),
        )  # fmt: skip
        data |= {
            f"frequency{end}": frequencies,
            f"measured{end}": measured,
            f"error{end}": errors,
            f"model{end}": model(fit.values),
        }
        if not end:
            drawn = model_of(held_twice_response, chain, frequencies, rate, late)
            other = _fit(drawn, measured, begun)
            quantities += (
                other.quantity(1, "damping_two_holds", "Nm s/rad",
                               "B if the A/D card is drawn as a hold, as in the thesis's fig C-1"),
                other.quantity(2, "delay_two_holds", "s", "software delay with that model"),
                Quantity("misfit_two_holds", other.misfit, math.nan, "", "rms with that model"),
            )  # fmt: skip
            total = float(late + fit.values[2])
            folded, wide = np.linspace(5.0, 0.4999 * rate, 800), np.linspace(5.0, 2.5 * rate, 2000)
            light, found = chain(_LIGHT), chain(float(fit.values[1]))
            data |= {
                "limit_delay": _PROFILE,
                "limit_rotor": misfit_profile(model, measured, fit),
                "limit_wire": wire_profile(frequencies, rate, total, _PROFILE + late),
                "folded_frequency": folded,
                "folded_light": sampled_response(light, folded, rate, total),
                "folded_found": sampled_response(found, folded, rate, total),
                "wide_frequency": wide,
                "wide_light": continuous_response(light, wide, total),
            }
    resonance = math.sqrt(settings.stiffness / settings.inertia) / (2.0 * math.pi)
    seen = abs(resonance - round(resonance / lab.rate) * lab.rate)
    quantities = beside(THESIS, quantities, MEASURED) + beside(THESIS, (
        Quantity("resonance", resonance, math.nan, "Hz", "undamped, from K and J"),
        Quantity("resonance_seen", seen, math.nan, "Hz", "where it folds to"),
    ), DERIVED)  # fmt: skip
    notes = (amplifier.note, *_notes(settings, pole, quantities, lab.rate))
    return Result(NAME, quantities, settings._asdict(), notes, data)


def _fit(model: Model, measured: np.ndarray, delay: float) -> Fit:
    """Return the best fit; delay: about the software's [s]."""
    fits = [
        fit_response(model, measured, (1.0, damping, delay), _LOW, _HIGH) for damping in _STARTS
    ]
    return min(fits, key=lambda fit: fit.misfit)


def _delay_seen(frequencies: np.ndarray, measured: np.ndarray, known: float) -> float:
    """Return about the delay [s] that the phases show beside a known one, 0.3 ms if none does."""
    early = (frequencies >= _EARLY[0]) & (frequencies <= _EARLY[1])
    if not early.any():
        return 3e-4
    seen = np.median(-np.angle(measured[early]) / (2.0 * np.pi * frequencies[early]))
    return float(np.clip(seen - known, 1e-5, 0.9 * _HIGH[2]))


def misfit_profile(model: Model, measured: np.ndarray, fit: Fit) -> np.ndarray:
    """Return the least misfit for each delay of `_PROFILE`, gain and damping fitted anew."""
    found, start, low, high = [], fit.values[:2], _LOW[:2], _HIGH[:2]

    def with_delay(delay: float) -> Model:
        return lambda numbers: model(np.append(numbers, delay))

    for delay in _PROFILE:
        best = fit_response(with_delay(delay), measured, start, low, high)
        found.append(best.misfit)
        start = np.clip(best.values, 1.001 * low, 0.999 * high)
    return np.array(found)


def wire_profile(
    frequencies: np.ndarray, rate: float, delay: float, delays: np.ndarray
) -> np.ndarray:
    """Return the misfit of a wire with each of `delays` [s] to a wire with `delay`, both sampled.

    It is 0 for all delays with the same number of periods after rounding up.
    """
    truth = sampled_response(WIRE, frequencies, rate, delay)
    off = [sampled_response(WIRE, frequencies, rate, float(d)) / truth - 1.0 for d in delays]
    return np.sqrt(np.mean(np.abs(off) ** 2, axis=1))


def _notes(
    settings: Settings, pole: float, quantities: tuple[Quantity, ...], rate: float
) -> tuple[str, ...]:
    found = {quantity.name: quantity for quantity in quantities}
    damping, delay = found["damping"], found["delay"]
    ratio = damping.value / (2.0 * math.sqrt(settings.stiffness * settings.inertia))
    corner = settings.stiffness / damping.value / (2.0 * math.pi)
    return (
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
        f"{0.05e6 / (2.0 * math.pi * pole):.0f} us. The thesis's limit applies to a "
        "plant without dynamics, not to sampled data in general.",
        f"With a second hold for the A/D card (fig C-1) the model lags {0.5e6 / rate:.0f} us more, "
        "and the fitted delay is shorter.",
    )


def draw(result: Result) -> Drawn:
    """Return figs 4-9 to 4-14, the folded resonance and the misfit of each delay."""
    d = result.data
    measured, name = (d["frequency"], d["measured"]), _name(result, "")
    title = "Fig. 4-11: phase of torque / commanded torque, linear scale"
    phase, axes = axes_for("frequency [Hz]", "phase [degrees]", title)
    axes.plot(d["frequency"], phase_degrees(d["measured"]), "o", color=_FIRST, ms=4,
              label="measured")  # fmt: skip
    axes.plot(d["frequency"], phase_degrees(d["model"]), color=_THIRD, label=name)
    axes.legend()
    figures = {
        "4-9": bode("Fig. 4-9: torque / commanded torque, 2 kHz", *measured),
        "4-10": bode("Fig. 4-10: torque / commanded torque, 2 kHz, with model", *measured,
                     {name: d["model"]}),
        "4-11": phase,
    }  # fmt: skip
    if "model_slow" in d:
        figures["4-12"] = bode(
            "Fig. 4-12: torque / commanded torque, 1 kHz, with model",
            d["frequency_slow"], d["measured_slow"], {_name(result, "_slow"): d["model_slow"]},
        )  # fmt: skip
    return figures | {
        "4-13": _wire("Fig. 4-13: unity gain, read and written at once", 0.0),
        "4-14": _wire("Fig. 4-14: unity gain with a delay of 0.4 samples", 0.4),
        "resonance": _resonance(result),
        "delay": _delay(result),
    }


def _name(result: Result, end: str) -> str:
    return (
        f"model: B = {result.value('damping' + end):.3g} Nm s/rad, "
        f"delay {1e6 * result.value('delay' + end):.0f} us"
    )


def _wire(title: str, delay: float) -> Figure:
    """Draw a sine through a hold, a wire with a delay [sample periods] and a sampler (4.1.4)."""
    time, read = np.arange(1600) / 100.0, np.arange(16.0)

    def held(at: np.ndarray) -> np.ndarray:
        return np.sin(2.0 * np.pi * 0.0625 * np.maximum(np.floor(at), 0.0))

    figure, axes = axes_for("time [sample periods]", "signal", title)
    axes.plot(time, held(time), color=_FIRST, lw=1.4, label="input, held")
    if delay:
        axes.plot(time, held(time - delay), color=_SECOND, lw=1.4, ls="--", label="output")
    samples = held(read - delay)
    axes.plot(read, samples, "x", color=DESIRED, ms=6, label="read")
    axes.plot(time, np.repeat(samples, 100), color=DESIRED, ls=":", lw=1.8,
              label="read, held again")  # fmt: skip
    axes.legend(loc="upper right")
    return figure


def _resonance(result: Result) -> Figure:
    """Draw responses of a lightly damped rotor, sampled and not, and of the measured one."""
    d, light = result.data, f"B = {_LIGHT:g} Nm s/rad"
    figure, axes = axes_for("frequency [Hz]", "torque / commanded torque [dB]",
                            "The resonance at 3600 Hz, and its alias at 2 kHz (4.1.3)")  # fmt: skip
    for at, name, colour, label in (
        ("wide_frequency", "wide_light", _SECOND, f"{light}, not sampled"),
        ("folded_frequency", "folded_light", _FIRST, f"{light}, sampled"),
        ("folded_frequency", "folded_found", _THIRD,
         f"B = {result.value('damping'):.3g} Nm s/rad as found, sampled"),
    ):  # fmt: skip
        axes.plot(d[at], decibels(d[name]), color=colour, label=label)
    axes.plot(d["frequency"], decibels(d["measured"]), "o", color=DESIRED, ms=3.5,
              label="measured")  # fmt: skip
    for name in ("resonance_seen", "resonance"):
        _mark(axes, result.value(name), "Hz", 0.985, "top")
    axes.set_ylim(-40.0, 30.0)
    axes.legend(loc="lower right")
    return figure


def _mark(axes: Axes, at: float, unit: str, height: float, va: str) -> None:
    axes.axvline(at, color="#888888", lw=0.7, ls="--", zorder=1)
    axes.annotate(f" {at:.0f} {unit}", (at, height), xycoords=("data", "axes fraction"), va=va,
                  fontsize=9)  # fmt: skip


def _delay(result: Result) -> Figure:
    d = result.data
    figure, axes = axes_for("software delay of the model [us]", "misfit, rms [%]",
                            "What sampled data tell of the software delay (4.1.4)")  # fmt: skip
    delay = 1e6 * d["limit_delay"]
    axes.plot(delay, 100.0 * d["limit_rotor"], color=_THIRD,
              label="this rotor: amplifier, J and K known, B fitted anew")  # fmt: skip
    axes.plot(delay, 100.0 * d["limit_wire"], color=_FIRST, drawstyle="steps-post",
              label="a wire behind the amplifier's delay: nothing within a sample")  # fmt: skip
    _mark(axes, 1e6 * result.value("delay"), "us", 0.6, "baseline")
    axes.set_ylim(-1.0, 1.25 * axes.get_ylim()[1])
    axes.legend(loc="upper left")
    return figure


EXPERIMENT = Experiment(
    NAME, "damping and delay of the locked rotor, and resolution of the delay (thesis 4.1.3)",
    Settings, run, draw, LOCKED_ROTOR, ("static_torque",),
)  # fmt: skip
