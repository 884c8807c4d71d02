# SPDX-License-Identifier: Apache-2.0
"""What the figures of several experiments share, in the style of the thesis.

Functions return matplotlib figures, drawn without a display. In figures of force over position the
desired spring is a heavy dotted line, arrows show the direction of travel, a circle the start.
Values that the thesis prints are diamonds or dotted lines, with credit in the legend.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import AutoMinorLocator, StrMethodFormatter
from scipy.signal import freqz

from ..figure_style import COLOURS, DESIRED, save
from .force_metric import Spring, spring_force

__all__ = ["axes_for", "bode", "error_map", "force_position", "path_views", "save"]
CREDIT = "S. P. Buerger, MIT 2001"
THESIS_RATE = 2000.0  # samples per second of the thesis [1/s]
_MOST_POINTS = 6000
_ARROWS = (0.15, 0.4, 0.65, 0.9)
_LINES = ((COLOURS[2], "-"), (DESIRED, "--"), (COLOURS[3], "-."))
_BAD_N = 3.0  # beside whose colour the numbers of a map are white


class Trace(NamedTuple):
    """Height [m], velocity [m/s] and force of the patient on the robot [N] at the same ticks."""

    name: str
    position: np.ndarray
    velocity: np.ndarray
    force: np.ndarray


class Path3D(NamedTuple):
    """Path of the handle in the frame manus_base: x, y, z [m], shape (samples, 3)."""

    name: str
    points: np.ndarray



def axes_for(x: str, y: str, title: str = "") -> tuple[Figure, Axes]:
    """Return a figure with one pair of axes, their labels and title."""
    figure = Figure(figsize=(7.2, 4.2), layout="constrained")
    axes = figure.add_subplot()
    axes.set(xlabel=x, ylabel=y)
    axes.set_title(title, loc="left")
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
    models: Mapping[str, np.ndarray] | None = None,
) -> Figure:
    """Draw a measured response, complex, as dots and models of it as lines; frequencies [Hz]."""
    figure = Figure(figsize=(7.2, 5.4), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    dots = {"marker": "o", "ls": "none", "ms": 4, "color": COLOURS[0], "label": "measured"}
    if models:
        dots |= {"mfc": "none", "mew": 0.9}
    above.plot(frequencies, 20.0 * np.log10(np.abs(measured)), **dots)
    below.plot(frequencies, phase_degrees(measured), **dots)
    for (name, model), (colour, dash) in zip((models or {}).items(), _LINES, strict=False):
        line = {"color": colour, "ls": dash, "label": name, "zorder": 3}
        above.plot(frequencies, 20.0 * np.log10(np.abs(model)), **line)
        below.plot(frequencies, phase_degrees(model), **line)
    above.set_xscale("log")
    above.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    above.set_title(title, loc="left")
    above.set_ylabel("magnitude [dB]")
    below.set_ylabel("phase [degrees]")
    below.set_xlabel("frequency [Hz]")
    if np.ptp(above.get_ylim()) < 1.0:
        middle = float(np.mean(above.get_ylim()))
        above.set_ylim(middle - 1.0, middle + 1.0)
    if models:
        below.legend(loc="lower left")
    return figure


def phase_degrees(values: np.ndarray) -> np.ndarray:
    """Return the phase of a complex response, without jumps [degrees]."""
    return np.degrees(np.unwrap(np.angle(values)))


def force_position(traces: Sequence[Trace], spring: Spring, title: str = "") -> Figure:
    """Draw force of the patient on the robot against height, with the desired spring.

    One line per trace. Raises ValueError without traces.
    """
    if not traces:
        raise ValueError("no traces to draw")
    figure = Figure(figsize=(7.2, 4.8), layout="constrained")
    axes = figure.add_subplot()
    for number, trace in enumerate(traces):
        _loop(axes, trace, COLOURS[number % len(COLOURS)])
    low = min(float(trace.position.min()) for trace in traces)
    high = max(float(trace.position.max()) for trace in traces)
    ends = np.array([low, high])
    axes.plot(
        ends,
        spring_force(ends, spring),
        color=DESIRED,
        linestyle=(0, (0.1, 1.8)),
        linewidth=3.2,
        dash_capstyle="round",
        label=f"desired: {spring.stiffness:g} N/m about {spring.centre:g} m",
        zorder=5,
    )
    axes.axhline(0.0, color="#888888", linewidth=0.6, zorder=1)
    axes.set_xlabel("handle height z [m]")
    axes.set_ylabel("force of the patient on the robot, up positive [N]")
    axes.xaxis.set_minor_locator(AutoMinorLocator())
    axes.yaxis.set_minor_locator(AutoMinorLocator())
    if title:
        axes.set_title(title, loc="left")
    axes.legend(loc="upper left")
    return figure


def path_views(
    paths: Sequence[Path3D], targets: np.ndarray | None = None, title: str = ""
) -> Figure:
    """Draw the handle's paths, each from above and from the front, side by side on one scale.

    targets: of the plane, x, y [m], shape (n, 2). Raises ValueError without paths.
    """
    if not paths:
        raise ValueError("no paths to draw")
    figure = Figure(figsize=(max(4.0, 3.0 * len(paths)), 5.6), layout="constrained")
    spans = np.ptp(np.concatenate([path.points for path in paths]), axis=0)
    views = figure.subplots(
        2, len(paths), sharex=True, sharey="row", squeeze=False,
        gridspec_kw={"height_ratios": np.maximum(spans[1:], 0.1 * spans.max())},
    )  # fmt: skip
    for (above, front), path, colour in zip(views.T, paths, COLOURS * len(paths), strict=False):
        if targets is not None:
            above.scatter(*targets.T, color=DESIRED, s=24, zorder=3, label="targets")
        x, y, z = path.points[:: _step(len(path.points))].T
        above.plot(x, y, color=colour, linewidth=0.8)
        front.plot(x, z, color=colour, linewidth=0.8)
        above.set_title(path.name, loc="left")
        front.set_xlabel("x, to the patient's right [m]")
        for axes in (above, front):
            axes.set_aspect("equal", adjustable="box")
    views[0, 0].set_ylabel("from above: y, away\nfrom the patient [m]")
    views[1, 0].set_ylabel("from the front: z, up [m]")
    if title:
        figure.suptitle(title)
    if targets is not None:
        figure.legend(*views[0, 0].get_legend_handles_labels(), loc="outside lower center")
    return figure


def _loop(axes: Axes, trace: Trace, colour: str) -> None:
    step = _step(len(trace.position))
    position, force = trace.position[::step], trace.force[::step]
    axes.plot(position, force, color=colour, label=trace.name, alpha=0.9)
    axes.plot(position[0], force[0], marker="o", markersize=7, markerfacecolor="none", color=colour)
    for share in _ARROWS:
        _arrow(axes, position, force, int(share * len(position)), colour)


def _arrow(axes: Axes, position: np.ndarray, force: np.ndarray, at: int, colour: str) -> None:
    """Draw an arrow head along the line at one sample, over a stretch long enough to show it."""
    span = max(1, len(position) // 60)
    begin, end = max(0, at - span), min(len(position) - 1, at + span)
    if abs(position[end] - position[begin]) < 0.02 * np.ptp(position):
        return  # at rest or at a reversal there is no direction
    near = slice(max(0, at - span // 2), at + span // 2 + 1)
    middle = float(np.median(force[near]))
    direction = np.sign(position[end] - position[begin])
    reach = 0.011 * np.ptp(position) * direction
    axes.annotate(
        "",
        xy=(position[at] + reach, middle),
        xytext=(position[at] - reach, middle),
        arrowprops={"arrowstyle": "-|>", "color": colour, "mutation_scale": 22, "lw": 0},
    )


def _step(samples: int) -> int:
    return max(1, samples // _MOST_POINTS)


def filter_figure(taps: np.ndarray, title: str) -> Figure:
    """Draw the gain of a low-pass with these coefficients at `THESIS_RATE` (figs 5-9, 5-31)."""
    frequency, gain = freqz(taps, worN=8192, fs=THESIS_RATE)
    figure, axes = axes_for("frequency [Hz]", "gain", title)
    axes.plot(frequency, np.maximum(np.abs(gain), 1e-6), color=COLOURS[0])
    axes.set_xlim(0.0, 150.0)
    axes.set_yscale("log")
    return figure


def error_map(table: np.ndarray, rows: Sequence[str], columns: Sequence[str], title: str) -> Figure:
    """Draw rms errors [N], shape (rows, columns), as a map with the numbers in it."""
    size = (max(5.5, 3.0 + 0.62 * len(columns)), 2.9 + 0.36 * len(rows))
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.add_subplot()
    axes.grid(False)
    image = axes.imshow(table, cmap="cividis_r", norm=LogNorm(0.05, 20.0, clip=True), aspect="auto")
    for (row, column), value in np.ndenumerate(table):
        axes.text(column, row, f"{value:.2g}", ha="center", va="center", fontsize=8,
                  color="white" if value > _BAD_N else "black")  # fmt: skip
    axes.set_yticks(range(len(rows)), rows)
    axes.set_xticks(range(len(columns)), [_case_text(name) for name in columns], rotation=55,
                    ha="right")  # fmt: skip
    axes.set_title(title, loc="left")
    figure.colorbar(image, ax=axes, label="rms force error [N]", shrink=0.8)
    return figure


def _case_text(name: str) -> str:
    """Return a trial's name for a reader: wall_1e4_badly_moved is a wall of 10 kN/m."""
    if not name.startswith("wall_"):
        return name.replace("_", " ")
    _, stiffness, *words = name.split("_")
    return ", ".join((f"wall {float(stiffness) * 1e-3:g} kN/m", *words))
