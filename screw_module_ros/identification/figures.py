# SPDX-License-Identifier: Apache-2.0
"""What the figures of several experiments share, in the style of the thesis.

Functions return matplotlib figures, drawn without a display. Values that the thesis prints are
diamonds or dotted lines, with credit in the legend.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from scipy.signal import freqz

from ..drawing import panels
from ..figure_style import COLOURS, DESIRED, save

__all__ = ["COLOURS", "DESIRED", "axes_for", "bode", "error_map", "panels", "save"]
CREDIT = "S. P. Buerger, MIT 2001"
THESIS_RATE = 2000.0  # [Hz] thesis: rate
_LINES = ((COLOURS[2], "-"), (DESIRED, "--"), (COLOURS[3], "-."))
_BAD_N = 3.0  # number of a map beside whose colour white digits are readable


def axes_for(x: str, y: str, title: str = "") -> tuple[Figure, Axes]:
    """Return a figure with one pair of axes, their labels and title."""
    figure, axes = panels()
    axes.set(xlabel=x, ylabel=y, title=title)
    return figure, axes


def printed(
    axes: Axes, x: Sequence[float] | np.ndarray, y: Sequence[float] | np.ndarray, what: str,
    line: bool = False,
) -> None:  # fmt: skip
    """Draw values that the thesis prints, with credit; what: and where, for the legend."""
    style: dict[str, Any] = (
        {"linestyle": ":", "linewidth": 1.8} if line else {"linestyle": "", "marker": "D"}
    )
    axes.plot(
        x, y, color=DESIRED, markerfacecolor="none", zorder=5, label=f"{what} ({CREDIT})", **style
    )


def bode(
    title: str,
    frequencies: np.ndarray,
    measured: np.ndarray,
    models: Mapping[str, np.ndarray] = {},
) -> Figure:
    """Draw a measured response, complex, as dots and models of it as lines; frequencies [Hz]."""
    figure, (above, below) = panels(2, 1, (7.2, 5.4), sharex=True)
    hollow = {"mfc": "none", "mew": 0.9} if models else {}
    for axes, part in ((above, decibels), (below, phase_degrees)):
        axes.plot(frequencies, part(measured), "o", ms=4, color=COLOURS[0], label="measured",
                  **hollow)  # fmt: skip
        for (name, model), (colour, dash) in zip(models.items(), _LINES, strict=False):
            axes.plot(frequencies, part(model), color=colour, ls=dash, label=name, zorder=3)
    above.set(xscale="log", ylabel="magnitude [dB]", title=title)
    above.xaxis.set_major_formatter("{x:g}")
    below.set(xlabel="frequency [Hz]", ylabel="phase [degrees]")
    if np.ptp(above.get_ylim()) < 1.0:
        middle = float(np.mean(above.get_ylim()))
        above.set_ylim(middle - 1.0, middle + 1.0)
    if models:
        below.legend(loc="lower left")
    return figure


def decibels(values: np.ndarray) -> np.ndarray:
    """Return the magnitude of a complex response [dB]."""
    return 20.0 * np.log10(np.abs(values))


def phase_degrees(values: np.ndarray) -> np.ndarray:
    """Return the phase of a complex response, without jumps [degrees]."""
    return np.degrees(np.unwrap(np.angle(values)))


def filter_figure(taps: np.ndarray, title: str) -> Figure:
    """Draw the gain of a low-pass with these coefficients at `THESIS_RATE` (figs 5-9, 5-31)."""
    frequency, gain = freqz(taps, worN=8192, fs=THESIS_RATE)
    figure, axes = axes_for("frequency [Hz]", "gain", title)
    axes.plot(frequency, np.maximum(np.abs(gain), 1e-6), color=COLOURS[0])
    axes.set(xlim=(0.0, 150.0), yscale="log")
    return figure


def error_map(
    rows: Mapping[str, Sequence[float]], columns: Sequence[str], title: str
) -> Figure:
    """Draw rows of rms errors [N] as a map with the numbers in it, the longer list downwards."""
    table, down = np.array(list(rows.values())), list(rows)
    across = [_case_text(name) for name in columns]
    if len(across) > len(down):
        table, down, across = table.T, across, down
    figure, axes = panels(size=(4.0 + 0.62 * len(across), 2.9 + 0.3 * len(down)))
    axes.grid(False)
    image = axes.imshow(table, cmap="cividis_r", norm=LogNorm(0.05, 20.0, clip=True), aspect="auto")
    for (row, column), value in np.ndenumerate(table):
        axes.text(column, row, f"{value:.2g}", ha="center", va="center", fontsize=8,
                  color="white" if value > _BAD_N else "black")  # fmt: skip
    axes.set_yticks(range(len(down)), down)
    axes.set_xticks(range(len(across)), across, rotation=55, ha="right")
    figure.suptitle(title, x=0.01, ha="left")
    figure.colorbar(image, ax=axes, label="rms force error [N]", shrink=0.8)
    return figure


def _case_text(name: str) -> str:
    """Return a trial's name for a reader: wall_1e4_badly_moved is a wall of 10 kN/m."""
    if not name.startswith("wall_"):
        return name.replace("_", " ")
    _, stiffness, *words = name.split("_")
    return ", ".join((f"wall {float(stiffness) * 1e-3:g} kN/m", *words))
