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
from scipy.signal import freqz

from ..figure_style import COLOURS, DESIRED, save
from .force_metric import Spring, spring_force

__all__ = [
    "COLOURS", "DESIRED", "axes_for", "bode", "error_map", "force_position", "panels", "path_views",
    "save",
]  # fmt: skip
CREDIT = "S. P. Buerger, MIT 2001"
THESIS_RATE = 2000.0  # [Hz] thesis: rate
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
    """Path of the handle in the frame manus_base: x, y, z [m], shape (samples, 3).

    targets: those of its movements in the plane, x, y [m].
    """

    name: str
    points: np.ndarray
    targets: Sequence[tuple[float, float]] = ()


def panels(
    rows: int = 1, columns: int = 1, size: tuple[float, float] = (7.2, 4.2), **more: Any
) -> tuple[Figure, Any]:
    """Return a figure of a size [inch], and its axes as `Figure.subplots` gives them."""
    figure = Figure(figsize=size, layout="constrained")
    return figure, figure.subplots(rows, columns, **more)


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


def force_position(traces: Sequence[Trace], spring: Spring, title: str = "") -> Figure:
    """Draw force of the patient on the robot against height, with the desired spring.

    One line per trace. Raises ValueError without traces.
    """
    if not traces:
        raise ValueError("no traces to draw")
    figure, axes = panels(size=(7.2, 4.8))
    for trace, colour in zip(traces, COLOURS * len(traces), strict=False):
        position, force = _thinned(trace.position), _thinned(trace.force)
        axes.plot(position, force, color=colour, label=trace.name, alpha=0.9)
        axes.plot(position[0], force[0], "o", markersize=7, markerfacecolor="none", color=colour)
        for share in _ARROWS:
            _arrow(axes, position, force, int(share * len(position)), colour)
    heights = np.concatenate([trace.position for trace in traces])
    ends = np.array([heights.min(), heights.max()])
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
    axes.set(xlabel="handle height z [m]", title=title,
             ylabel="force of the patient on the robot, up positive [N]")  # fmt: skip
    axes.minorticks_on()
    axes.legend(loc="upper left")
    return figure


def path_views(paths: Sequence[Path3D], title: str = "") -> Figure:
    """Draw the handle's paths, each from above and from the front, side by side on one scale.

    Each is drawn with its own targets. Raises ValueError without paths.
    """
    if not paths:
        raise ValueError("no paths to draw")
    spans = np.ptp(np.concatenate([path.points for path in paths]), axis=0)
    figure, views = panels(
        2, len(paths), (max(4.0, 3.0 * len(paths)), 5.6), sharex=True, sharey="row", squeeze=False,
        gridspec_kw={"height_ratios": np.maximum(spans[1:], 0.1 * spans.max())},
    )  # fmt: skip
    for (above, front), path, colour in zip(views.T, paths, COLOURS * len(paths), strict=False):
        if path.targets:
            across, away = zip(*path.targets, strict=True)
            above.scatter(across, away, color=DESIRED, s=24, zorder=3, label="targets")
        x, y, z = _thinned(path.points).T
        above.plot(x, y, color=colour, linewidth=0.8)
        front.plot(x, z, color=colour, linewidth=0.8)
        above.set_title(path.name)
        front.set_xlabel("x, to the patient's right [m]")
        for axes in (above, front):
            axes.set_aspect("equal", adjustable="box")
    views[0, 0].set_ylabel("from above: y, away\nfrom the patient [m]")
    views[1, 0].set_ylabel("from the front: z, up [m]")
    if title:
        figure.suptitle(title)
    if paths[0].targets:
        figure.legend(*views[0, 0].get_legend_handles_labels(), loc="outside lower center")
    return figure


def _arrow(axes: Axes, position: np.ndarray, force: np.ndarray, at: int, colour: str) -> None:
    """Draw an arrow head along the line at one sample, over a stretch long enough to show it."""
    span, whole = max(1, len(position) // 60), np.ptp(position)
    way = position[min(len(position) - 1, at + span)] - position[max(0, at - span)]
    if abs(way) < 0.02 * whole:
        return  # at rest or at a reversal there is no direction
    middle = float(np.median(force[max(0, at - span // 2) : at + span // 2 + 1]))
    reach = 0.011 * whole * np.sign(way)
    axes.annotate(
        "",
        xy=(position[at] + reach, middle),
        xytext=(position[at] - reach, middle),
        arrowprops={"arrowstyle": "-|>", "color": colour, "mutation_scale": 22, "lw": 0},
    )


def _thinned(samples: np.ndarray) -> np.ndarray:
    return samples[:: max(1, len(samples) // _MOST_POINTS)]


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
