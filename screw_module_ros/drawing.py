# SPDX-License-Identifier: Apache-2.0
"""Figures of the handle, in the style of the thesis: force over height, and its path.

Functions return matplotlib figures, drawn without a display. In figures of force over position the
desired spring is a heavy dotted line, arrows show the direction of travel, a circle the start.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .figure_style import COLOURS, DESIRED
from .offset import Spring, spring_force

_MOST_POINTS = 6000
_ARROWS = (0.15, 0.4, 0.65, 0.9)


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
