# SPDX-License-Identifier: Apache-2.0
"""Figures of force over position and of the handle's path, in the style of thesis chapter 6.

Functions return matplotlib figures, drawn without a display. The desired spring is a heavy dotted
line, arrows show the direction of travel, a circle the start.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import AutoMinorLocator

from screw_module_ros.figure_style import COLOURS, DESIRED, STYLE

from ..force_position import Spring, spring_force

_MOST_POINTS = 6000
_ARROWS = (0.15, 0.4, 0.65, 0.9)


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


def force_position(traces: Sequence[Trace], spring: Spring, title: str = "") -> Figure:
    """Draw force of the patient on the robot against height, with the desired spring.

    One line per trace. Raises ValueError without traces.
    """
    if not traces:
        raise ValueError("no traces to draw")
    with rc_context(STYLE):
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
    """Draw the handle's paths from above and from the front.

    targets: of the plane, x, y [m], shape (n, 2). Raises ValueError without paths.
    """
    if not paths:
        raise ValueError("no paths to draw")
    with rc_context(STYLE):
        figure = Figure(figsize=(9.0, 4.8), layout="constrained")
        above, front = figure.subplots(1, 2)
        if targets is not None:
            above.scatter(*targets.T, color=DESIRED, s=36, zorder=3, label="targets")
        for number, path in enumerate(paths):
            x, y, z = path.points[:: _step(len(path.points))].T
            line = {"color": COLOURS[number % len(COLOURS)], "label": path.name, "alpha": 0.9}
            above.plot(x, y, **line)
            front.plot(x, z, **line)
        for axes, name, upward in (
            (above, "from above", "y, away from the patient [m]"),
            (front, "from the front", "z, up [m]"),
        ):
            axes.set_title(name)
            axes.set_xlabel("x, to the patient's right [m]")
            axes.set_ylabel(upward)
            axes.set_aspect("equal", adjustable="datalim")
        if title:
            figure.suptitle(title)
        handles, labels = above.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
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
