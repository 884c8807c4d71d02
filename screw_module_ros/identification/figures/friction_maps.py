# SPDX-License-Identifier: Apache-2.0
"""Figures of the friction maps, in the style of thesis figures 5-9 to 5-23."""

from __future__ import annotations

import numpy as np
from matplotlib import colormaps, rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FixedLocator
from scipy.signal import freqz

from screw_module_ros.figure_style import COLOURS, STYLE

from ..friction_bins import lowpass_taps
from ..friction_map import measured, nearest
from ..results import Result

HEIGHT = "height of the nut on the screw z [mm]"
FORCE = "force of the stage on the robot [N]"
MAGNITUDE = "force downward [N]"
SPEED = "speed [mm/s]"
_DOUBLE_WEIGHT = 20.0  # [N], the shift of the thesis's figures
RATE = 2000.0  # samples per second of the thesis [1/s]
_PLACES = ((25.0, 50.0), (250.0, 275.0))
_TICKS = (0.5, 1.0, 2.5, 5.0, 10.0, 25.0, 50.0, 150.0)
_SLOW = 0.05  # fastest of fig 5-13 [m/s]
_COMPARED = 0.005  # speed of the upside-down figures [m/s]


def friction_map_figures(result: Result) -> dict[str, Figure]:
    """Return the figures by number; those upside down only if measured."""
    data = result.data
    found = {"5-9": filter_figure(
        lowpass_taps(0.025, RATE), "Fig. 5-9: optimal low-pass for 25 mm/s"
    )}
    numbered = (("up", 1.0, ("5-10", "5-11")), ("down", -1.0, ("5-16", "5-17")))
    for direction, sign, numbers in numbered:
        for number, place in zip(numbers, _PLACES, strict=True):
            found[number] = _against_speed(data, direction, sign, place, number)
    found["5-12"] = _along_screw(data, (("up", 1.0, 0.0, "up"),), 0.05, "Fig. 5-12: upward", FORCE)
    found["5-13"] = _all_speeds(data)
    found["5-14"] = _surface(data)
    found["5-18"] = _along_screw(
        data, (("down", 1.0, 0.0, "down"),), 0.05, "Fig. 5-18: downward", FORCE
    )
    found["5-19"] = _along_screw(
        data,
        (("up", 1.0, 0.0, "up"), ("down", -1.0, _DOUBLE_WEIGHT, "down, mirrored, 20 N added")),
        0.05, "Fig. 5-19: both ways", FORCE,
    )  # fmt: skip
    if len(measured(data, "up_inverted")):
        found.update(_upside_down(data))
    return found


def axes_for(x: str, y: str) -> tuple[Figure, Axes]:
    """Return a figure with one pair of axes and their labels."""
    figure = Figure(figsize=(7.2, 4.2), layout="constrained")
    axes = figure.add_subplot()
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    return figure, axes


def filter_figure(taps: np.ndarray, title: str) -> Figure:
    """Draw the gain of a low-pass with these coefficients at `RATE` (figs 5-9, 5-31)."""
    frequency, gain = freqz(taps, worN=8192, fs=RATE)
    with rc_context(STYLE):
        figure, axes = axes_for("frequency [Hz]", "gain")
        axes.plot(frequency, np.maximum(np.abs(gain), 1e-6), color=COLOURS[0])
        axes.set_xlim(0.0, 150.0)
        axes.set_yscale("log")
        axes.set_title(title, loc="left")
    return figure


def _against_speed(
    data: dict[str, np.ndarray],
    direction: str,
    sign: float,
    place: tuple[float, float],
    number: str,
) -> Figure:
    """Draw force over speed for the bins of a stretch of the screw."""
    there = measured(data, direction)
    bins = np.flatnonzero((data["centres"] > place[0]) & (data["centres"] < place[1]))
    speeds = data["speeds"][there] * 1e3
    curves = sign * data[direction][there][:, bins]
    with rc_context(STYLE):
        figure, axes = axes_for(SPEED, FORCE if sign > 0.0 else MAGNITUDE)
        axes.plot(speeds, curves, color=COLOURS[5], linewidth=0.9)
        axes.plot([], [], color=COLOURS[5], label=f"{len(bins)} bins of 2.5 mm")
        axes.plot(
            speeds, np.nanmean(curves, axis=1), color=COLOURS[0], linewidth=2.2, marker=".",
            label="their mean",
        )  # fmt: skip
        axes.set_title(
            f"Fig. {number}: {place[0]:g} to {place[1]:g} mm from the bottom, {direction}ward",
            loc="left",
        )
        axes.legend(loc="best")
    return figure


def _along_screw(
    data: dict[str, np.ndarray],
    curves: tuple[tuple[str, float, float, str], ...],
    speed: float,
    title: str,
    label: str,
    upto: float = 355.0,
) -> Figure:
    """Draw maps over height at one speed; curves: map, factor, shift [N], label."""
    shown = data["centres"] <= upto
    with rc_context(STYLE):
        figure, axes = axes_for(HEIGHT, label)
        for number, (name, factor, shift, text) in enumerate(curves):
            row = nearest(data, name, speed)
            axes.plot(
                data["centres"][shown], factor * data[name][row][shown] + shift,
                color=COLOURS[2 * number], linestyle=("-", "--")[number % 2], label=text,
            )  # fmt: skip
        axes.set_xlim(0.0, upto)
        axes.set_title(f"{title}, {data['speeds'][row] * 1e3:g} mm/s", loc="left")
        if len(curves) > 1:
            axes.legend(loc="best")
    return figure


def _all_speeds(data: dict[str, np.ndarray]) -> Figure:
    """Draw force over height upward, one line per speed up to 50 mm/s (fig 5-13)."""
    rows = [row for row in measured(data, "up") if data["speeds"][row] <= _SLOW + 1e-9]
    with rc_context(STYLE):
        figure, axes = axes_for(HEIGHT, FORCE)
        _by_speed(axes, data, rows)
        axes.set_xlim(0.0, 355.0)
        axes.set_title("Fig. 5-13: upward, up to 50 mm/s", loc="left")
        axes.legend(loc="upper left", ncols=2, title=SPEED)
    return figure


def _by_speed(axes: Axes, data: dict[str, np.ndarray], rows: list[int]) -> None:
    for share, row in zip(np.linspace(0.0, 0.92, len(rows)), rows, strict=True):
        axes.plot(
            data["centres"], data["up"][row], color=colormaps["viridis"](share), linewidth=0.8,
            label=f"{data['speeds'][row] * 1e3:g}",
        )  # fmt: skip


def _surface(data: dict[str, np.ndarray]) -> Figure:
    """Draw the map upward as a surface over height and speed (fig 5-14)."""
    there = measured(data, "up")
    speeds = np.log10(data["speeds"][there] * 1e3)
    ticks = [tick for tick in _TICKS if speeds[0] - 1e-9 <= np.log10(tick) <= speeds[-1] + 1e-9]
    z, v = np.meshgrid(data["centres"], speeds)
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 5.4), layout="constrained")
        axes = figure.add_subplot(projection="3d")
        axes.plot_surface(
            z, v, data["up"][there], cmap="viridis", linewidth=0.0, rcount=20, ccount=142
        )
        axes.set_xlabel("height z [mm]")
        axes.set_ylabel("speed [mm/s], logarithmic", labelpad=8)
        axes.set_zlabel("force [N]")
        axes.yaxis.set_major_locator(FixedLocator(np.log10(ticks)))
        axes.yaxis.set_major_formatter(FixedFormatter([f"{tick:g}" for tick in ticks]))
        axes.view_init(elev=28, azim=-125)
        axes.set_box_aspect(None, zoom=0.86)
        axes.set_title("Fig. 5-14: force over height and speed, upward", loc="left")
    return figure


def _upside_down(data: dict[str, np.ndarray]) -> dict[str, Figure]:
    """Draw upright beside upside down (figs 5-20 to 5-23)."""
    shift = _DOUBLE_WEIGHT
    return {
        "5-20": _along_screw(
            data,
            (
                ("up", 1.0, 0.0, "upright, against gravity"),
                ("up_inverted", 1.0, shift, "upside down, with gravity, 20 N added"),
            ),
            _COMPARED, "Fig. 5-20: plus direction", FORCE,
        ),
        "5-21": _along_screw(
            data,
            (
                ("down", -1.0, shift, "upright, with gravity, 20 N added"),
                ("down_inverted", -1.0, 0.0, "upside down, against gravity"),
            ),
            _COMPARED, "Fig. 5-21: minus direction", MAGNITUDE,
        ),
        "5-22": _along_screw(
            data,
            (
                ("down", -1.0, 0.0, "upright, minus direction"),
                ("up_inverted", 1.0, 0.0, "upside down, plus direction"),
            ),
            _COMPARED, "Fig. 5-22: with gravity", "force along the motion [N]",
        ),
        "5-23": _along_screw(
            data,
            (
                ("down", -1.0, 0.0, "upright, with gravity"),
                ("down_inverted", -1.0, -shift, "upside down, against gravity, 20 N less"),
            ),
            _COMPARED, "Fig. 5-23: minus direction, lower half", MAGNITUDE, 177.5,
        ),
    }  # fmt: skip
