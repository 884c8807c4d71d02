# SPDX-License-Identifier: Apache-2.0
"""Figures of the force's spectrum and of its repeatability (thesis figs 5-7, 5-8, 5-15)."""

from __future__ import annotations

from matplotlib import rc_context
from matplotlib.figure import Figure

from screw_module_ros.figure_style import COLOURS, STYLE

from ..friction_spectrum import Peak
from ..friction_spectrum import nearest as nearest_line
from ..results import Result
from .friction_maps import FORCE, HEIGHT, axes_for

_NEAR = 10.0  # where fig 5-8 ends [Hz]
_FAR = 500.0  # where fig 5-7 ends [Hz]


def spectrum_figures(result: Result) -> dict[str, Figure]:
    """Return figures 5-7 and 5-8, upward."""
    speed = result.settings["speed"] * 1e3
    return {
        "5-7": _spectrum(result, _FAR, f"Fig. 5-7: spectrum of the force, {speed:g} mm/s upward"),
        "5-8": _spectrum(result, _NEAR, f"Fig. 5-8: its lower end, {speed:g} mm/s upward"),
    }


def _spectrum(result: Result, upto: float, title: str) -> Figure:
    frequency, amplitude = result.data["frequency_up"], result.data["amplitude_up"]
    shown = frequency <= upto
    with rc_context(STYLE):
        figure, axes = axes_for("frequency [Hz]", "amplitude of the force [N]")
        axes.plot(frequency[shown], amplitude[shown], color=COLOURS[0])
        axes.set_xlim(0.0, upto)
        if upto <= _NEAR:
            axes.set_ylim(bottom=0.0)
            _name_lines(axes, result)
        else:  # the noise is not visible on a linear scale
            axes.set_yscale("log")
            axes.set_ylim(bottom=1e-5)
        axes.set_title(title, loc="left")
    return figure


def _name_lines(axes, result: Result) -> None:
    peaks = [Peak(*row) for row in result.data["peaks_up"]]
    for name, text in (("screw", "turn of the screw"), ("rollers", "rollers")):
        peak = nearest_line(peaks, result.value(f"{name}_up"))
        if peak:
            axes.annotate(
                f"{text}, {peak.frequency:.2f} Hz, {peak.amplitude:.2f} N",
                (peak.frequency, peak.amplitude), xytext=(12, -4), textcoords="offset points",
                va="center",
            )  # fmt: skip


def repeatability_figures(result: Result) -> dict[str, Figure]:
    """Return figure 5-15, with the difference of the two runs."""
    speed = result.settings["speed"] * 1e3
    centres, (first, second) = result.data["centres"], result.data["up"]
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 5.4), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
        above.plot(centres, first, color=COLOURS[0], label="first run")
        above.plot(centres, second, color=COLOURS[2], linestyle="--", label="second run")
        above.set_ylabel(FORCE)
        above.set_title(f"Fig. 5-15: two runs upward, {speed:g} mm/s", loc="left")
        above.legend(loc="upper left")
        below.plot(centres, second - first, color=COLOURS[0])
        below.axhline(0.0, color="#888888", linewidth=0.6)
        below.set_ylabel("difference [N]")
        below.set_xlabel(HEIGHT)
        below.set_xlim(0.0, 355.0)
    return {"5-15": figure}
