# SPDX-License-Identifier: Apache-2.0
"""Figures of the inertia's identification (thesis figs 5-31 to 5-34)."""

from __future__ import annotations

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from screw_module_ros.figure_style import COLOURS, DESIRED, STYLE

from ..friction_bins import optimal_lowpass
from ..mass_estimates import CUTOFF_HZ, STOP_HZ
from ..results import Result
from .friction_maps import RATE, axes_for, filter_figure

_LONG, _SHORT = 4.0, 1.2  # seconds of figs 5-32 and 5-33
_SCALE = 0.2  # of the force in fig 5-33
_BEGIN = 2.0  # after the record's beginning [s]


def inertia_figures(result: Result, record: int = 2) -> dict[str, Figure]:
    """Return the figures by number, from one of the records."""
    record = min(record, len(result.data["shifts"]) - 1)
    names = ("time", "acceleration", "inertial", "ratio")
    time, acceleration, inertial, ratio = (result.data[f"{name}_{record}"] for name in names)
    time = time - time[0] - _BEGIN
    return {
        "5-31": filter_figure(
            optimal_lowpass(CUTOFF_HZ, STOP_HZ, RATE),
            "Fig. 5-31: low-pass of velocity and acceleration",
        ),
        "5-32": _curves(
            time, acceleration, inertial, 1.0, _LONG, "Fig. 5-32: force less friction and weight"
        ),
        "5-33": _curves(
            time, acceleration, inertial, _SCALE, _SHORT, "Fig. 5-33: the same force times 0.2"
        ),
        "5-34": _ratio(result, time, acceleration, ratio),
    }


def _curves(
    time: np.ndarray,
    acceleration: np.ndarray,
    inertial: np.ndarray,
    scale: float,
    length: float,
    title: str,
) -> Figure:
    """Draw mass times acceleration, by the forces, and acceleration over time."""
    shown = (time >= 0.0) & (time <= length)
    factor = "" if scale == 1.0 else f", times {scale:g}"
    with rc_context(STYLE):
        figure, axes = axes_for("time [s]", "force [N] and acceleration [m/s$^2$]")
        axes.plot(
            time[shown], scale * inertial[shown], color=COLOURS[0],
            label=f"force less friction and weight [N]{factor}",
        )  # fmt: skip
        axes.plot(
            time[shown], acceleration[shown], color=COLOURS[2], linestyle="--",
            label="acceleration [m/s$^2$]",
        )  # fmt: skip
        axes.set_xlim(0.0, length)
        axes.margins(y=0.2)
        axes.set_title(title, loc="left")
        axes.legend(loc="upper right", ncols=2)
    return figure


def _ratio(
    result: Result, time: np.ndarray, acceleration: np.ndarray, ratio: np.ndarray
) -> Figure:
    """Draw the mass at each sample, zero for excluded ones, and the acceleration (fig 5-34)."""
    shown = (time >= 0.0) & (time <= _LONG)
    with rc_context(STYLE):
        figure, axes = axes_for("time [s]", "mass [kg] and acceleration [m/s$^2$]")
        axes.plot(
            time[shown], acceleration[shown], color=COLOURS[2], linestyle="--",
            label="acceleration [m/s$^2$]",
        )  # fmt: skip
        axes.plot(time[shown], ratio[shown], color=COLOURS[0], label="ratio [kg], 0 = left out")
        mass = result.value("mass")
        axes.axhline(mass, color=DESIRED, linestyle=":", label=f"by regression, {mass:.2f} kg")
        axes.set_xlim(0.0, _LONG)
        axes.margins(y=0.2)
        axes.set_title("Fig. 5-34: mass by the ratio, where acceleration is 2.5 m/s$^2$ and more",
                       loc="left")  # fmt: skip
        axes.legend(loc="upper right", ncols=3)
    return figure
