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


def stability_figures(result: Result) -> dict[str, Figure]:
    """Draw the largest stable gain over the delay and over the mass of the arm at the handle."""
    data = result.data
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 4.2), layout="constrained")
        left, right = figure.subplots(1, 2, sharey=True)
        for number, name in enumerate(("feedback", "observer")):
            style = {"color": COLOURS[number], "label": name}
            left.plot(1e3 * data["delays"], data[f"delay_{name}"], **style)
            right.plot(data["masses"], data[f"mass_{name}"], **style)
        for number, axes in enumerate((left, right)):
            axes.axhline(5.0, color=DESIRED, linewidth=0.8, linestyle="--")
            axes.set_yscale("log")
            axes.set_xlabel(
                ("delay from sample to current [ms]", "mass of the arm at the handle [kg]")[number]
            )
        right.set_xscale("log")
        left.set_ylabel("largest stable force gain")
        left.set_title("What the linear loop allows (7.1); dashed: the thesis's 5", loc="left")
        left.legend()
    return {"stability": figure}


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
    axes.set_xticks(np.arange(len(names)), names, rotation=60, ha="right")
    axes.legend(ncols=2)
    return figure
