# SPDX-License-Identifier: Apache-2.0
"""Figure of the force error in the plane, with and without compensation."""

from __future__ import annotations

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from screw_module_ros.figure_style import COLOURS, STYLE

from ..force_metric import ErrorOf
from ..results import Result


def planar_error_figures(result: Result) -> dict[str, Figure]:
    """Draw the rms error of every trial with every compensation."""
    names, kinds = list(result.settings["cases"]), list(result.settings["kinds"])
    width = 0.8 / len(kinds)
    with rc_context(STYLE):
        figure = Figure(figsize=(9.0, 4.6), layout="constrained")
        axes = figure.add_subplot()
        for number, kind in enumerate(kinds):
            rms = [ErrorOf(*result.data[f"{kind}_{name}"]).rms for name in names]
            axes.bar(
                np.arange(len(names)) + (number - 0.5 * (len(kinds) - 1)) * width, rms, width,
                color=COLOURS[number % len(COLOURS)], label=f"compensated: {kind}",
            )  # fmt: skip
        axes.set_yscale("log")
        axes.set_xticks(np.arange(len(names)), names, rotation=60, ha="right")
        axes.set_ylabel("rms force error in the plane, all samples [N]")
        axes.set_title("What the hand feels beyond the impedance asked for, plane", loc="left")
        axes.legend(ncols=2)
    return {"planar error": figure}
