# SPDX-License-Identifier: Apache-2.0
"""Maps of the force at constant speed over height and speed (thesis 5.2.4, figs 5-10 to 5-23).

The positioning stage drives the handle up and down the screw at 14 speeds, upright and upside down,
with no torque commanded; `stage_runs` averages each run over bins of 2.5 mm. Heights and the
direction "up" refer to the screw, also upside down, as in the thesis. The force is that of the
stage on the robot, up the screw positive.
"""

from __future__ import annotations

from functools import partial
from typing import Annotated, NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FixedLocator

from ..calibration.module import thesis_friction
from ..control.friction import friction_force
from ..geometry import SCREW
from ..settings import Setting
from .figures import COLOURS, THESIS_RATE, axes_for, filter_figure, printed
from .lab import Lab
from .results import STAGE, Drawn, Experiment, Published, Quantity, Result, beside
from .stage_runs import BINS, CENTRES_MM, LOWER_HALF, binned, lowpass_taps, range_flaw, stage_run
from .trials import DIRECTIONS, StageTrial

NAME = "friction_map"
_BY_EYE = (
    "the thesis reads 40 N s/m off fig 5-10, and the polynomials of 5.2.5, fitted to the same data "
    "and given to the plant, have about 18 N s/m there (docs/contradictions.md)"
)
THESIS = {
    "stribeck_up": Published("stribeck_speed", 0.007, given_to_plant=True),
    "viscous_5_10_up": Published("viscous_by_eye", 8.0, _BY_EYE, given_to_plant=True),
}
# The thesis has 14 speeds and names 0.5, 5, 20, 25, 40, 50 and 150 mm/s; the other seven are ours.
# Its model has its knee at 2.5 mm/s.
SPEEDS = (
    0.0005, 0.001, 0.0025, 0.005, 0.010, 0.015, 0.020,
    0.025, 0.040, 0.050, 0.075, 0.100, 0.125, 0.150,
)  # fmt: skip
MAPS = ("up", "down", "up_inverted", "down_inverted")
_FIG_5_10 = (CENTRES_MM > 25.0) & (CENTRES_MM < 50.0)
_VISCOUS_FROM = 0.025  # speed above the Stribeck velocity [m/s], thesis 5.2.4
HEIGHT = "height of the nut on the screw z [mm]"
FORCE = "force of the stage on the robot [N]"
MAGNITUDE = "force downward [N]"
SPEED = "speed [mm/s]"
_DOUBLE_WEIGHT = 20.0  # [N] thesis: gravity_about x 2; the shift of the figures
_TICKS = (0.5, 1.0, 2.5, 5.0, 10.0, 25.0, 50.0, 150.0)
_SLOW = 0.05  # fastest of fig 5-13 [m/s]
_COMPARED = 0.005  # [m/s] thesis: inverted_speed


class Settings(NamedTuple):
    """Speeds and range of heights; the stage of the thesis moves at 0.5 to 150 mm/s."""

    speeds: Annotated[
        tuple[float, ...], Setting("stage speeds, upright, ascending", "m/s", 1e-4, 1.0)
    ] = SPEEDS
    inverted_speeds: Annotated[
        tuple[float, ...], Setting("some of the speeds or none, module upside down", "m/s")
    ] = SPEEDS
    low: Annotated[float, Setting("lowest height of the handle", "m", 0.0, 0.3)] = 0.0
    high: Annotated[float, Setting("highest height of the handle", "m", 0.05, 0.36)] = 0.36

    def flaw(self) -> str:
        """Return what does not fit together."""
        if sorted(set(self.speeds)) != list(self.speeds) or not self.speeds:
            return f"speeds = {self.speeds}: must be ascending, without repetition"
        if unknown := set(self.inverted_speeds) - set(self.speeds):
            return f"inverted_speeds: {min(unknown):g} m/s is not among the speeds"
        return range_flaw(self.low, self.high, 0.03)


def run(lab: Lab, settings: Settings) -> Result:
    """Measure the maps.

    Data: `speeds` [m/s], shape (n,), ascending; `centres` of the bins [mm], (142,); for each of
    `MAPS` the force [N] `NAME`, its standard error [N] `NAME_error` and samples `NAME_count`, all
    (n, 142), NaN for bins not measured. Raises the errors of `Lab.record`.
    """
    speeds = settings.speeds
    parts = lab.record(NAME, _trials(settings), partial(binned, screw=lab.stand.screw))
    data = {"speeds": np.array(speeds), "centres": CENTRES_MM}
    for name in MAPS:
        rows = [parts.get(_trial_name(name, speed)) for speed in speeds]
        for key, suffix in (("force", ""), ("error", "_error"), ("count", "_count")):
            nothing = np.full(BINS, 0 if key == "count" else np.nan)
            data[name + suffix] = np.array([row[key] if row else nothing for row in rows])
    notes = [
        "Up and down are directions on the screw, also upside down (thesis 5.2.4).",
        "The uncertainty of a mean force includes the sensor's noise, but not its zero.",
    ]
    if empty := int(np.isnan(data["up"]).sum(axis=1).max()):
        notes.append(
            f"Up to {empty} of {BINS} bins of a run lie where the stage accelerates or brakes; "
            "they stay empty and are not interpolated."
        )
    quantities = beside(THESIS, _quantities(data))
    return Result(NAME, quantities, settings._asdict(), tuple(notes), data)


def measured(data: dict[str, np.ndarray], name: str) -> np.ndarray:
    """Return the indices of the speeds at which a map of `MAPS` was measured."""
    return np.flatnonzero(np.isfinite(data[name]).any(axis=1))


def nearest(data: dict[str, np.ndarray], name: str, speed: float) -> int:
    """Return the index of the measured speed nearest to `speed` [m/s].

    Raises ValueError if the map was not measured.
    """
    there = measured(data, name)
    if not len(there):
        raise ValueError(f"the map {name} was not measured")
    return int(there[np.argmin(np.abs(data["speeds"][there] - speed))])


def mean_over(data: dict[str, np.ndarray], name: str, bins: np.ndarray) -> np.ndarray:
    """Return the mean force of a map over bins (a mask of 142) at each speed [N].

    Only bins measured at every speed count, so that bins missing at high speed cause no trend.
    """
    force = data[name][:, bins]
    there = measured(data, name)
    whole = np.isfinite(force[there]).all(axis=0)
    means = np.full(len(force), np.nan)
    if whole.any():
        means[there] = force[there][:, whole].mean(axis=1)
    return means


def stribeck_velocity(speeds: np.ndarray, friction: np.ndarray) -> tuple[float, float]:
    """Return the speed of least friction after its peak at low speed, and its uncertainty [m/s].

    speeds [m/s], ascending; friction: magnitude [N] at these speeds. The uncertainty is a quarter
    of the distance between the neighbouring speeds. NaN if friction has no inner minimum.
    """
    inner = np.arange(1, len(speeds) - 1)
    lows = inner[(friction[inner] < friction[inner - 1]) & (friction[inner] <= friction[inner + 1])]
    if not len(lows):
        return np.nan, np.nan
    at = lows[np.argmin(friction[lows])]
    x, y = np.log(speeds[at - 1 : at + 2]), friction[at - 1 : at + 2]
    curve, slope, _ = np.polyfit(x - x[1], y, 2)
    best = float(np.exp(x[1] - slope / (2.0 * curve)))
    return best, float(0.25 * (speeds[at + 1] - speeds[at - 1]))


def _trials(settings: Settings) -> dict[str, StageTrial]:
    return {
        _trial_name(name + ("_inverted" if inverted else ""), speed): stage_run(
            sign * float(speed), settings.low, settings.high, inverted
        )
        for inverted, speeds in ((False, settings.speeds), (True, settings.inverted_speeds))
        for speed in speeds
        for name, sign in DIRECTIONS
    }


def _trial_name(name: str, speed: float) -> str:
    return f"{name}_{speed * 1e3:g}mm_s"


def _quantities(data: dict[str, np.ndarray]) -> tuple[Quantity, ...]:
    quantities = []
    for name in MAPS:
        if not len(there := measured(data, name)):
            continue
        force, error = data[name][there], data[f"{name}_error"][there]
        filled = np.isfinite(force)
        text = name.replace("_inverted", ", upside down")
        spread = float(np.sqrt(np.nansum(error**2)) / filled.sum())
        quantities += [
            Quantity(f"mean_{name}", float(np.nanmean(force)), spread, "N", f"mean force, {text}"),
            Quantity(f"filled_{name}", float(filled.mean()), np.nan, "", f"bins measured, {text}"),
        ]
    for name, sign in DIRECTIONS:
        quantities += _of_speed(data, name, sign)
    return tuple(quantities)


def _of_speed(data: dict[str, np.ndarray], name: str, sign: float) -> list[Quantity]:
    """Return the fit of friction against speed in one direction."""
    there = measured(data, name)
    speeds = data["speeds"][there]
    friction = {
        part: sign * mean_over(data, name, bins)[there]
        for part, bins in (("lower", LOWER_HALF), ("upper", ~LOWER_HALF), ("5_10", _FIG_5_10))
    }
    quantities = [
        Quantity(f"stribeck_{name}", *stribeck_velocity(speeds, friction["lower"]), "m/s",
                 f"speed of least friction, lower half, {name}")
    ]  # fmt: skip
    fast = speeds >= _VISCOUS_FROM
    for part, force in friction.items():
        if np.isfinite(force[fast]).sum() < 4:
            continue
        (slope, _), cov = np.polyfit(speeds[fast], force[fast], 1, cov=True)
        where = "25 to 50 mm, as fig 5-10" if part == "5_10" else f"{part} half"
        quantities.append(
            Quantity(
                f"viscous_{part}_{name}", float(slope), float(np.sqrt(cov[0, 0])), "N s/m",
                f"rise with speed above 25 mm/s, {where}, {name}",
            )
        )  # fmt: skip
    return quantities


def draw(result: Result) -> Drawn:
    """Return the figures by number; those upside down only if measured."""
    data = result.data
    taps = lowpass_taps(0.025, THESIS_RATE, SCREW)
    found = {
        "5-9": filter_figure(taps, "Fig. 5-9: optimal low-pass for 25 mm/s"),
        "5-13": _all_speeds(data),
        "5-14": _surface(data),
    }
    for number, (direction, sign, place) in _AGAINST.items():
        found[number] = _against_speed(data, direction, sign, place, number)
    turned = len(measured(data, "up_inverted")) > 0
    for number, (_, _, _, curves, _) in _ALONG.items():
        if turned or not any("inverted" in name for name, *_ in curves):
            found[number] = _along_screw(data, number)
    return {number: found[number] for number in sorted(found, key=lambda one: int(one[2:]))}


_AGAINST = {
    "5-10": ("up", 1.0, (25.0, 50.0)), "5-11": ("up", 1.0, (250.0, 275.0)),
    "5-16": ("down", -1.0, (25.0, 50.0)), "5-17": ("down", -1.0, (250.0, 275.0)),
}  # fmt: skip
"""Figures over speed: map, sign, and the bins' range of heights [mm]."""
_ALONG = {
    "5-12": ("upward", FORCE, 0.05, (("up", 1.0, 0.0, "up"),), 355.0),
    "5-18": ("downward", FORCE, 0.05, (("down", 1.0, 0.0, "down"),), 355.0),
    "5-19": ("both ways", FORCE, 0.05, (
        ("up", 1.0, 0.0, "up"), ("down", -1.0, _DOUBLE_WEIGHT, "down, mirrored, 20 N added"),
    ), 355.0),
    "5-20": ("plus direction", FORCE, _COMPARED, (
        ("up", 1.0, 0.0, "upright, against gravity"),
        ("up_inverted", 1.0, _DOUBLE_WEIGHT, "upside down, with gravity, 20 N added"),
    ), 355.0),
    "5-21": ("minus direction", MAGNITUDE, _COMPARED, (
        ("down", -1.0, _DOUBLE_WEIGHT, "upright, with gravity, 20 N added"),
        ("down_inverted", -1.0, 0.0, "upside down, against gravity"),
    ), 355.0),
    "5-22": ("with gravity", "force along the motion [N]", _COMPARED, (
        ("down", -1.0, 0.0, "upright, minus direction"),
        ("up_inverted", 1.0, 0.0, "upside down, plus direction"),
    ), 355.0),
    "5-23": ("minus direction, lower half", MAGNITUDE, _COMPARED, (
        ("down", -1.0, 0.0, "upright, with gravity"),
        ("down_inverted", -1.0, -_DOUBLE_WEIGHT, "upside down, against gravity, 20 N less"),
    ), 177.5),
}  # fmt: skip
"""Figures over height: title; label of the ordinate; speed [m/s]; curves: map, factor, shift [N],
label; greatest height [mm]."""


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
    title = f"Fig. {number}: {place[0]:g} to {place[1]:g} mm from the bottom, {direction}ward"
    figure, axes = axes_for(SPEED, FORCE if sign > 0.0 else MAGNITUDE, title)
    axes.plot(speeds, curves, color=COLOURS[5], linewidth=0.9)
    axes.plot([], [], color=COLOURS[5], label=f"{len(bins)} bins of 2.5 mm")
    axes.plot(
        speeds, np.nanmean(curves, axis=1), color=COLOURS[0], linewidth=2.2, marker=".",
        label="their mean",
    )  # fmt: skip
    model = thesis_friction()
    fast = speeds[speeds >= model.ramp_speed_mm_s]
    level = [friction_force(model, 0.5e-3 * sum(place), sign * 1e-3 * speed) for speed in fast]
    printed(axes, fast, sign * (np.array(level) + model.gravity_N), "polynomials of 5.2.5", True)
    axes.legend(loc="best")
    return figure


def _along_screw(data: dict[str, np.ndarray], number: str) -> Figure:
    """Draw maps over height at one speed."""
    title, label, speed, curves, upto = _ALONG[number]
    shown = data["centres"] <= upto
    figure, axes = axes_for(HEIGHT, label)
    for curve, (name, factor, shift, text) in enumerate(curves):
        row = nearest(data, name, speed)
        axes.plot(
            data["centres"][shown], factor * data[name][row][shown] + shift,
            color=COLOURS[2 * curve], linestyle=("-", "--")[curve % 2], label=text,
        )  # fmt: skip
    axes.set(xlim=(0.0, upto), title=f"Fig. {number}: {title}, {data['speeds'][row] * 1e3:g} mm/s")
    if len(curves) > 1:
        axes.legend(loc="best")
    return figure


def _all_speeds(data: dict[str, np.ndarray]) -> Figure:
    """Draw force over height upward, one line per speed up to 50 mm/s (fig 5-13)."""
    rows = [row for row in measured(data, "up") if data["speeds"][row] <= _SLOW + 1e-9]
    figure, axes = axes_for(HEIGHT, FORCE, "Fig. 5-13: upward, up to 50 mm/s")
    for share, row in zip(np.linspace(0.0, 0.92, len(rows)), rows, strict=True):
        axes.plot(
            data["centres"], data["up"][row], color=colormaps["viridis"](share), linewidth=0.8,
            label=f"{data['speeds'][row] * 1e3:g}",
        )  # fmt: skip
    axes.set_xlim(0.0, 355.0)
    axes.legend(loc="upper left", ncols=2, title=SPEED)
    return figure


def _surface(data: dict[str, np.ndarray]) -> Figure:
    """Draw the map upward as a surface over height and speed (fig 5-14)."""
    there = measured(data, "up")
    speeds = np.log10(data["speeds"][there] * 1e3)
    ticks = [tick for tick in _TICKS if speeds[0] - 1e-9 <= np.log10(tick) <= speeds[-1] + 1e-9]
    figure = Figure(figsize=(7.2, 5.4), layout="constrained")
    axes = figure.add_subplot(projection="3d")
    axes.plot_surface(
        *np.meshgrid(data["centres"], speeds), data["up"][there], cmap="viridis", linewidth=0.0,
        rcount=20, ccount=142,
    )  # fmt: skip
    axes.set(xlabel="height z [mm]", zlabel="force [N]")
    axes.set_ylabel("speed [mm/s], logarithmic", labelpad=8)
    axes.yaxis.set_major_locator(FixedLocator(np.log10(ticks).tolist()))
    axes.yaxis.set_major_formatter(FixedFormatter([f"{tick:g}" for tick in ticks]))
    axes.view_init(elev=28, azim=-125)
    axes.set_box_aspect(None, zoom=0.86)
    axes.set_title("Fig. 5-14: force over height and speed, upward", loc="left")
    return figure


EXPERIMENT = Experiment(
    NAME, "maps of the force at constant speed over height and speed (thesis 5.2.4)", Settings,
    run, draw, STAGE,
)  # fmt: skip
