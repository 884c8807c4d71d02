# SPDX-License-Identifier: Apache-2.0
"""Figure of the force error in the plane, with and without compensation."""

from __future__ import annotations

from matplotlib import rc_context
from matplotlib.figure import Figure

from screw_module_ros.figure_style import STYLE

from ..results import Result
from .stability import error_bars


def planar_error_figures(result: Result) -> dict[str, Figure]:
    """Draw the rms error of every trial with every compensation."""
    with rc_context(STYLE):
        figure = error_bars(
            result, {kind: f"compensated: {kind}" for kind in result.settings["kinds"]}
        )
        (axes,) = figure.axes
        axes.set_ylabel("rms force error in the plane, all samples [N]")
        axes.set_title("What the hand feels beyond the impedance asked for, plane", loc="left")
    return {"planar error": figure}
