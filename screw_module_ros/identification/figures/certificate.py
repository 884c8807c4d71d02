# SPDX-License-Identifier: Apache-2.0
"""Figure of the module's certificate: delivered impedance in every mode (thesis 7.1)."""

from __future__ import annotations

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from screw_module_ros.figure_style import COLOURS, DESIRED, STYLE

from ...control.modes import MODE_NAMES, OFF
from ..results import Result

_BARS = {
    "friction": "friction felt",
    "hold": "held still",
    "release": "released",
    "wall": "on a wall",
}


def certificate_figures(result: Result) -> dict[str, Figure]:
    """Draw the impedance at the handle over the frequency, and friction and errors at rest."""
    names = [name.lower() for mode, name in MODE_NAMES.items() if mode != OFF]
    with rc_context(STYLE):
        figure = Figure(figsize=(9.0, 4.4), layout="constrained")
        left, right = figure.subplots(1, 2)
        _impedance(left, result, names)
        _forces(right, result, names)
    return {"certificate": figure}


def _impedance(axes: Axes, result: Result, names: list[str]) -> None:
    frequencies = result.data["frequencies"]
    for number, name in enumerate(names):
        size = np.hypot(result.data[f"resistance_{name}"], result.data[f"reactance_{name}"])
        axes.loglog(
            frequencies, size, marker="o", markersize=3.0, color=COLOURS[number],
            label=name.replace("_", " "),
        )  # fmt: skip
    spring = result.settings["stiffness"] / (2.0 * np.pi * frequencies)
    axes.loglog(frequencies, spring, color=DESIRED, linestyle="--", label="spring asked for")
    axes.set_xlabel("frequency [Hz]")
    axes.set_ylabel("force over velocity at the handle [Ns/m]")
    axes.set_title("What the handle delivers", loc="left")
    axes.legend()


def _forces(axes: Axes, result: Result, names: list[str]) -> None:
    known = {q.name: q.value for q in result.quantities}
    bars = [bar for bar in _BARS if f"{bar}_{names[0]}" in known]
    width = 0.8 / len(names)
    for number, name in enumerate(names):
        at = np.arange(len(bars)) + (number - 0.5 * (len(names) - 1)) * width
        sizes = [abs(known[f"{bar}_{name}"]) for bar in bars]
        axes.bar(at, sizes, width, color=COLOURS[number], label=name.replace("_", " "))
    axes.set_yscale("log")
    axes.set_xticks(np.arange(len(bars)), [_BARS[bar] for bar in bars])
    axes.set_ylabel("force [N]")
    axes.set_title("Friction felt, and force error at rest", loc="left")
