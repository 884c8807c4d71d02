# SPDX-License-Identifier: Apache-2.0
"""Figures of the largest stable force gain (7.1), and of the force error over all samples."""

from __future__ import annotations

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from screw_module_ros.figure_style import COLOURS, DESIRED, STYLE

from ...control.modes import MODE_NAMES
from ..force_metric import ErrorOf
from ..results import Result
from ..stability import CURVES

_WIDTHS = (1.1, 1.1, 4.0)  # the last line lies under the one before, where they are equal


def stability_figures(result: Result) -> dict[str, Figure]:
    """Draw the largest stable gain over the delay and over the mass of the arm at the handle."""
    data = result.data
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 4.2), layout="constrained")
        left, right = figure.subplots(1, 2, sharey=True)
        for number, (name, label) in enumerate(CURVES.items()):
            style = {"color": COLOURS[number], "label": label, "marker": "o", "markersize": 2.5,
                     "zorder": 2.5 - 0.1 * number, "linewidth": _WIDTHS[number]}
            left.plot(1e3 * data["delays"], _stable(data[f"delay_{name}"]), **style)
            right.plot(data["masses"], _stable(data[f"mass_{name}"]), **style)
        for number, axes in enumerate((left, right)):
            axes.axhline(5.0, color=DESIRED, linewidth=0.8, linestyle="--")
            axes.set_yscale("log")
            axes.set_xlabel(
                ("delay from sample to current [ms]", "mass of the arm at the handle [kg]")[number]
            )
        right.set_xscale("log")
        left.set_ylim(bottom=1.0)
        left.set_ylabel("largest stable force gain")
        left.set_title("A hand of 3 kg", loc="left")
        right.set_title("The loop's own delay", loc="left")
        figure.suptitle(
            "Largest force gain of the linear loop (7.1); dashed: the thesis's 5", x=0.01, ha="left"
        )
        figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return {"stability": figure}


def _stable(gains: np.ndarray) -> np.ndarray:
    """Return the gains, NaN where none is stable."""
    return np.where(gains > 0.0, gains, np.nan)


def force_error_figures(result: Result) -> dict[str, Figure]:
    """Draw the rms error of every mode in every trial."""
    modes = (MODE_NAMES[mode].lower() for mode in result.settings["modes"])
    labels = {mode: mode.replace("_", " ") for mode in modes}
    with rc_context(STYLE):
        figure = error_bars(result, labels)
        (axes,) = figure.axes
        axes.set_ylabel("rms force error, all samples [N]")
        axes.set_title("What the hand feels beyond the impedance asked for", loc="left")
    return {"force error": figure}


def error_bars(result: Result, labels: dict[str, str]) -> Figure:
    """Draw the rms error of every trial as a group of bars.

    labels: by the names that come before those of the trials in the result's data.
    """
    names, width = list(result.settings["cases"]), 0.8 / len(labels)
    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    axes = figure.add_subplot()
    for number, (kind, label) in enumerate(labels.items()):
        rms = [ErrorOf(*result.data[f"{kind}_{name}"]).rms for name in names]
        axes.bar(
            np.arange(len(names)) + (number - 0.5 * (len(labels) - 1)) * width, rms, width,
            color=COLOURS[number % len(COLOURS)], label=label,
        )  # fmt: skip
    axes.set_yscale("log")
    ticks = [_case_text(name) for name in names]
    axes.set_xticks(np.arange(len(names)), ticks, rotation=60, ha="right")
    figure.legend(loc="outside upper right", ncols=len(labels))
    return figure


def _case_text(name: str) -> str:
    """Return a trial's name for a reader: wall_1e4_badly is a wall of 10 kN/m, badly damped."""
    if not name.startswith("wall_"):
        return name.replace("_", " ")
    _, stiffness, damped = name.split("_")
    return f"wall {float(stiffness) * 1e-3:g} kN/m, {damped}"
