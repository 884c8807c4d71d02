# SPDX-License-Identifier: Apache-2.0
"""Figures of chapter 4: static torque, and the responses of amplifier, current and torque.

Each function takes an experiment's result and returns its figures by the thesis's numbers.
"""

from __future__ import annotations

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from screw_module_ros.figure_style import COLOURS, DESIRED, STYLE

from ..delay_limit import held_wire
from ..results import Result
from .bode import bode, phase_degrees

_EVERY = 5  # samples to one dot
_FIRST, _SECOND, _THIRD = COLOURS[:3]


def static_torque_figures(result: Result) -> dict[str, Figure]:
    """Return figs 4-2 to 4-4."""
    d = result.data
    raw = f"correlation {result.value('correlation_raw'):.5f}"
    after = f"correlation {result.value('correlation'):.5f}"
    figures = {}
    figure, axes = _plain("Fig. 4-2: torque against commanded current")
    _dots(axes, d["command"], d["torque"], f"measured, {raw}")
    _named(axes, "commanded current [A]", "torque [Nm]")
    figures["4-2"] = figure
    figure, axes = _plain("Fig. 4-3: commanded current against desired torque")
    _dots(axes, d["torque"], d["command"], "measured")
    axes.plot(d["fit_torque"], d["fit_command"], color=_THIRD, lw=1.6, label="line, cubic, line")
    joints = [result.value("lower_joint"), result.value("upper_joint")]
    at = np.interp(joints, d["fit_torque"], d["fit_command"])
    axes.plot(joints, at, "o", color=_THIRD, mfc="white", label="joints", zorder=4)
    _named(axes, "desired torque [Nm]", "commanded current [A]")
    _closeup(axes, d)
    figures["4-3"] = figure
    figure, axes = _plain("Fig. 4-4: torque against current, using the linearization")
    _dots(axes, d["linear_desired"], d["linear_torque"], f"measured, {after}")
    ends = np.array([d["linear_desired"].min(), d["linear_desired"].max()])
    line = result.value("slope") * result.settings["torque_constant"] * ends
    axes.plot(ends, line, color=_THIRD, label="straight line")
    _named(axes, "desired current [A]", "torque [Nm]")
    figures["4-4"] = figure
    return figures


def amplifier_figures(result: Result) -> dict[str, Figure]:
    """Return figs 4-5 and 4-6."""
    d = result.data
    name = f"model: {result.value('pole'):.4g} Hz, {1e6 * result.value('delay'):.3g} us"
    measured = (d["frequency"], d["measured"])
    return {
        "4-5": bode("Fig. 4-5: amplifier, current / commanded current", *measured),
        "4-6": bode("Fig. 4-6: amplifier, with fitted model", *measured, {name: d["model"]}),
    }


def current_figures(result: Result) -> dict[str, Figure]:
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


def torque_figures(result: Result) -> dict[str, Figure]:
    """Return figs 4-9 to 4-14, the folded resonance and the misfit of each delay."""
    d = result.data
    measured = (d["frequency"], d["measured"])
    model = {_name(result, ""): d["model"]}
    figures = {
        "4-9": bode("Fig. 4-9: torque / commanded torque, 2 kHz", *measured),
        "4-10": bode("Fig. 4-10: torque / commanded torque, 2 kHz, with model", *measured, model),
        "4-11": _linear_phase(result),
    }
    if "model_slow" in d:
        figures["4-12"] = bode(
            "Fig. 4-12: torque / commanded torque, 1 kHz, with model",
            d["frequency_slow"], d["measured_slow"], {_name(result, "_slow"): d["model_slow"]},
        )  # fmt: skip
    figures["4-13"] = _wire("Fig. 4-13: unity gain, read and written at once", 0.0)
    figures["4-14"] = _wire("Fig. 4-14: unity gain with a delay of 0.4 samples", 0.4)
    figures["resonance"] = _resonance(result)
    figures["delay"] = _delay(result)
    return figures


def _name(result: Result, end: str) -> str:
    return (
        f"model: B = {result.value('damping' + end):.3g} Nm s/rad, "
        f"delay {1e6 * result.value('delay' + end):.0f} us"
    )


def _linear_phase(result: Result) -> Figure:
    d = result.data
    figure, axes = _plain("Fig. 4-11: phase of torque / commanded torque, linear scale")
    axes.plot(
        d["frequency"], phase_degrees(d["measured"]), "o", color=_FIRST, ms=4, label="measured"
    )
    axes.plot(d["frequency"], phase_degrees(d["model"]), color=_THIRD, label=_name(result, ""))
    _named(axes, "frequency [Hz]", "phase [degrees]")
    return figure


def _wire(title: str, delay: float) -> Figure:
    held = held_wire(delay, periods=16)
    figure, axes = _plain(title)
    axes.plot(held.time, held.input, color=_FIRST, lw=1.4, label="input, held")
    if delay:
        axes.plot(held.time, held.answer, color=_SECOND, lw=1.4, ls="--", label="output")
    axes.plot(held.sample_time, held.samples, "x", color=DESIRED, ms=6, label="read")
    axes.plot(held.time, held.rebuilt, color=DESIRED, ls=":", lw=1.8, label="read, held again")
    _named(axes, "time [sample periods]", "signal", "upper right")
    return figure


def _resonance(result: Result) -> Figure:
    """Draw responses of a lightly damped rotor, sampled and not, and of the measured one."""
    d = result.data
    light = f"B = {float(d['light_damping']):g} Nm s/rad"
    figure, axes = _plain("The resonance at 3600 Hz and where 2 kHz samples fold it to (4.1.3)")
    axes.plot(d["wide_frequency"], _decibels(d["wide_light"]), color=_SECOND,
              label=f"{light}, not sampled")  # fmt: skip
    axes.plot(d["folded_frequency"], _decibels(d["folded_light"]), color=_FIRST,
              label=f"{light}, sampled")  # fmt: skip
    axes.plot(d["folded_frequency"], _decibels(d["folded_found"]), color=_THIRD,
              label=f"B = {result.value('damping'):.3g} Nm s/rad as found, sampled")  # fmt: skip
    axes.plot(d["frequency"], _decibels(d["measured"]), "o", color=DESIRED, ms=3.5,
              label="measured")  # fmt: skip
    for name in ("resonance_seen", "resonance"):
        at = result.value(name)
        axes.axvline(at, color="#888888", lw=0.7, ls="--", zorder=1)
        axes.annotate(f" {at:.0f} Hz", (at, 0.985), xycoords=("data", "axes fraction"), va="top",
                      fontsize=9)  # fmt: skip
    axes.set_ylim(-40.0, 30.0)
    _named(axes, "frequency [Hz]", "torque / commanded torque [dB]", "lower right")
    return figure


def _delay(result: Result) -> Figure:
    d = result.data
    figure, axes = _plain("What sampled data tell of the software delay (4.1.4)")
    delay = 1e6 * d["limit_delay"]
    axes.plot(delay, 100.0 * d["limit_rotor"], color=_THIRD,
              label="this rotor: amplifier, J and K known, B fitted anew")  # fmt: skip
    axes.plot(delay, 100.0 * d["limit_wire"], color=_FIRST, drawstyle="steps-post",
              label="a wire behind the amplifier's delay: nothing within a sample")  # fmt: skip
    found = 1e6 * result.value("delay")
    axes.axvline(found, color="#888888", lw=0.7, ls="--", zorder=1)
    axes.annotate(f" {found:.0f} us", (found, 0.6), xycoords=("data", "axes fraction"), fontsize=9)
    axes.set_ylim(-1.0, 1.25 * axes.get_ylim()[1])
    _named(axes, "software delay of the model [us]", "misfit, rms [%]", "upper left")
    return figure


def _closeup(axes: Axes, data: dict[str, np.ndarray]) -> None:
    inner = axes.inset_axes((0.62, 0.1, 0.36, 0.4))
    _dots(inner, data["torque"], data["command"], "")
    inner.plot(data["fit_torque"], data["fit_command"], color=_THIRD, lw=1.6)
    inner.set_xlim(-0.04, 0.04)
    inner.set_ylim(-0.45, 0.45)
    inner.tick_params(labelsize=8)
    inner.set_title("near zero", fontsize=9)


def _dots(axes: Axes, x: np.ndarray, y: np.ndarray, label: str) -> None:
    axes.plot(x[::_EVERY], y[::_EVERY], ".", ms=1.5, color=_FIRST, alpha=0.6)
    if label:
        axes.plot([], [], ".", ms=6, color=_FIRST, label=label)


def _plain(title: str) -> tuple[Figure, Axes]:
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 4.4), layout="constrained")
        axes = figure.add_subplot()
        axes.set_title(title, loc="left")
    return figure, axes


def _named(axes: Axes, x: str, y: str, where: str = "best") -> None:
    with rc_context(STYLE):
        axes.set_xlabel(x)
        axes.set_ylabel(y)
        axes.legend(loc=where)


def _decibels(values: np.ndarray) -> np.ndarray:
    return 20.0 * np.log10(np.abs(values))
