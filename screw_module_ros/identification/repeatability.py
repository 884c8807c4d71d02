# SPDX-License-Identifier: Apache-2.0
"""Repeatability of two runs of the stage at one speed, bin by bin (thesis 5.2.4, fig 5-15)."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from ..settings import Setting, validated
from .friction_bins import CENTRES_MM, binned
from .lab import Job, Lab
from .results import Quantity, Result
from .trials import DIRECTIONS, StageTrial

NAME = "repeatability"
_WHOLE = 0.9  # least share of a bin's samples for the comparison


class Settings(NamedTuple):
    """The two runs in each direction."""

    speed: Annotated[float, Setting("of the stage", "m/s", 1e-4, 0.5)] = 0.050
    low: Annotated[float, Setting("lowest height of the handle", "m", 0.0, 0.3)] = 0.0
    high: Annotated[float, Setting("highest height of the handle", "m", 0.05, 0.36)] = 0.36
    apart: Annotated[
        float, Setting("offset of the second run's start", "m", 0.0, 0.01)
    ] = 0.001


def run(lab: Lab, settings: Settings) -> Result:
    """Compare two runs up, and two down.

    Data: `centres` [mm]; `up`, `down` [N], shape (2, 142), NaN for bins not measured. Raises
    ValueError for inconsistent settings, and the errors of `Lab.run`.
    """
    validated(settings)
    if settings.high - settings.low < 0.03:
        raise ValueError("high must lie above low by 0.03 m or more")
    jobs = [
        _job(settings, direction, sign, number)
        for direction, sign in DIRECTIONS for number in (1, 2)
    ]  # fmt: skip
    parts = lab.run(NAME, jobs)
    data = {"centres": CENTRES_MM}
    quantities = []
    for direction, _ in DIRECTIONS:
        first, second = (parts[f"{direction}_{number}"] for number in (1, 2))
        data[direction] = np.array([first["force"], second["force"]])
        quantities += _compared(direction, first, second)
    notes = (
        "On a simulated module friction repeats exactly; only the transducer's noise and zero "
        "differ. On a real module the difference limits the accuracy of every map.",
    )
    return Result(NAME, tuple(quantities), settings._asdict(), notes, data)


def _job(settings: Settings, direction: str, sign: float, number: int) -> Job:
    ends = [float(settings.low), float(settings.high)][:: int(sign)]
    ends[0] += sign * settings.apart * (number - 1)
    trial = StageTrial(sign * float(settings.speed), ends[0], ends[1])
    return Job(f"{direction}_{number}", trial, binned)


def _compared(direction: str, first: dict, second: dict) -> list[Quantity]:
    fewer = np.minimum(first["count"], second["count"])
    beyond = np.where(fewer > _WHOLE * np.median(fewer), second["force"] - first["force"], np.nan)
    noise = float(np.sqrt(np.nanmean(first["error"] ** 2 + second["error"] ** 2)))
    known = np.isfinite(beyond)
    count = int(known.sum())
    spread = float(beyond[known].std(ddof=1))
    return [
        Quantity(
            f"deviation_{direction}", spread, spread / np.sqrt(2.0 * (count - 1)), "N",
            f"standard deviation of the difference, {direction}",
        ),
        Quantity(
            f"difference_{direction}", float(beyond[known].mean()), spread / np.sqrt(count), "N",
            f"mean difference, second minus first, {direction}",
        ),
        Quantity(
            f"noise_{direction}", noise, float("nan"), "N",
            f"difference that noise makes, {direction}",
        ),
    ]  # fmt: skip
