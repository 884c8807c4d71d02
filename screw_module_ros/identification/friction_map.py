# SPDX-License-Identifier: Apache-2.0
"""Maps of the force at constant speed over height and speed (thesis 5.2.4, figs 5-10 to 5-23).

The positioning stage drives the handle up and down the screw at 14 speeds, upright and upside down,
with no torque commanded; `friction_bins` averages each run over bins of 2.5 mm. Heights and the
direction "up" refer to the screw, also upside down, as in the thesis. The force is that of the
stage on the robot, up the screw positive.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from ..settings import Setting, validated
from .friction_bins import BINS, CENTRES_MM, RANGE_MM, binned
from .lab import Job, Lab
from .results import Quantity, Result
from .trials import StageTrial

NAME = "friction_map"
# The thesis names 0.5, 5, 10, 20, 25, 40, 50 and 150 mm/s; the other six are ours. Its model has
# its knee at 2.5 mm/s.
SPEEDS = (
    0.0005, 0.001, 0.0025, 0.005, 0.010, 0.015, 0.020,
    0.025, 0.040, 0.050, 0.075, 0.100, 0.125, 0.150,
)  # fmt: skip
MAPS = ("up", "down", "up_inverted", "down_inverted")
_VISCOUS_FROM = 0.025  # above the Stribeck velocity [m/s], thesis 5.2.4
_LOWER = CENTRES_MM < 0.5 * RANGE_MM


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


def run(lab: Lab, settings: Settings) -> Result:
    """Measure the maps.

    Data: `speeds` [m/s], shape (n,), ascending; `centres` of the bins [mm], (142,); for each of
    `MAPS` the force [N] `NAME`, its standard error [N] `NAME_error` and samples `NAME_count`, all
    (n, 142), NaN for bins not measured. Raises ValueError for inconsistent settings, and the errors
    of `Lab.run`.
    """
    speeds = _checked(settings)
    jobs = _jobs(settings)
    parts = lab.run(NAME, jobs)
    data = {"speeds": np.array(speeds), "centres": CENTRES_MM}
    for name in MAPS:
        rows = [parts.get(_job_name(name, speed)) for speed in speeds]
        for key, suffix in (("force", ""), ("error", "_error"), ("count", "_count")):
            nothing = np.full(BINS, 0 if key == "count" else np.nan)
            data[name + suffix] = np.array([row[key] if row else nothing for row in rows])
    return Result(NAME, _quantities(data), settings._asdict(), _notes(data), data)


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


def _checked(settings: Settings) -> tuple[float, ...]:
    validated(settings)
    speeds = tuple(float(speed) for speed in settings.speeds)
    if sorted(set(speeds)) != list(speeds) or not speeds:
        raise ValueError(f"speeds = {settings.speeds}: must be ascending, without repetition")
    unknown = [speed for speed in settings.inverted_speeds if speed not in speeds]
    if unknown:
        raise ValueError(f"inverted_speeds: {unknown[0]:g} m/s is not among the speeds")
    if settings.high - settings.low < 0.03:
        raise ValueError("high must lie above low by 0.03 m or more")
    return speeds


def _jobs(settings: Settings) -> list[Job]:
    jobs = []
    for inverted in (False, True):
        for speed in settings.inverted_speeds if inverted else settings.speeds:
            for name, sign in (("up", 1.0), ("down", -1.0)):
                ends = (float(settings.low), float(settings.high))[:: int(sign)]
                trial = StageTrial(sign * float(speed), *ends, upside_down=inverted)
                name += "_inverted" if inverted else ""
                jobs.append(Job(_job_name(name, speed), trial, binned))
    return jobs


def _job_name(name: str, speed: float) -> str:
    return f"{name}_{speed * 1e3:g}mm_s"


def _quantities(data: dict[str, np.ndarray]) -> tuple[Quantity, ...]:
    quantities = []
    for name in MAPS:
        there = measured(data, name)
        if not len(there):
            continue
        force, error = data[name][there], data[f"{name}_error"][there]
        filled = np.isfinite(force)
        text = name.replace("_inverted", ", upside down")
        spread = float(np.sqrt(np.nansum(error**2)) / filled.sum())
        quantities += [
            Quantity(f"mean_{name}", float(np.nanmean(force)), spread, "N", f"mean force, {text}"),
            Quantity(f"filled_{name}", float(filled.mean()), np.nan, "", f"bins measured, {text}"),
        ]
    for name, sign in (("up", 1.0), ("down", -1.0)):
        quantities += _of_speed(data, name, sign)
    return tuple(quantities)


def _of_speed(data: dict[str, np.ndarray], name: str, sign: float) -> list[Quantity]:
    """Return the fit of friction against speed in one direction."""
    there = measured(data, name)
    speeds = data["speeds"][there]
    lower = sign * mean_over(data, name, _LOWER)[there]
    stribeck = stribeck_velocity(speeds, lower)
    quantities = [
        Quantity(
            f"stribeck_{name}", *stribeck, "m/s", f"speed of least friction, lower half, {name}"
        )
    ]
    for half, bins in (("lower", _LOWER), ("upper", ~_LOWER)):
        fast = speeds >= _VISCOUS_FROM
        force = sign * mean_over(data, name, bins)[there]
        if np.isfinite(force[fast]).sum() < 4:
            continue
        (slope, _), cov = np.polyfit(speeds[fast], force[fast], 1, cov=True)
        quantities.append(
            Quantity(
                f"viscous_{half}_{name}", float(slope), float(np.sqrt(cov[0, 0])), "N s/m",
                f"rise with speed above 25 mm/s, {half} half, {name}",
            )
        )  # fmt: skip
    return quantities


def _notes(data: dict[str, np.ndarray]) -> tuple[str, ...]:
    notes = [
        "Up and down are directions on the screw, also upside down (thesis 5.2.4).",
        "The uncertainty of a mean force includes the sensor's noise, but not its zero.",
    ]
    empty = np.isnan(data["up"]).sum(axis=1)
    if empty.any():
        notes.append(
            f"Up to {int(empty.max())} of {BINS} bins of a run lie where the stage accelerates or "
            "brakes; they stay empty and are not interpolated."
        )
    return tuple(notes)
