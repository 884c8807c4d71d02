# SPDX-License-Identifier: Apache-2.0
"""Weight of the parts that move up and down, by two methods (thesis 5.2.4, figs 5-20 to 5-23).

The thesis takes half of the mean difference between runs upright and upside down in the lower half
of the screw. That is exact only if friction against gravity equals friction with gravity. The
thesis found that they differ; half of the difference is an error of its weight. Our method measures
the weight at the beginning of a creeping run, while the handle crosses the play (`play_crossing`).
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from ..geometry import counts_to_height
from ..settings import Setting, validated
from . import friction_map
from .friction_bins import CENTRES_MM, RANGE_MM
from .lab import Job, Lab
from .play_crossing import Crossing, Weight, crossing, play_width, traced, weighed
from .results import Quantity, Result
from .trials import NotPossible, StageTrial

NAME = "gravity"
_LOWER = CENTRES_MM < 0.5 * RANGE_MM


class Settings(NamedTuple):
    """The creeping runs; the maps come from friction_map."""

    speeds: Annotated[
        tuple[float, ...], Setting("of the stage across the play", "m/s", 1e-4, 5e-3)
    ] = (0.0005, 0.001, 0.002)
    heights: Annotated[
        tuple[float, ...], Setting("start of the runs; friction holds the nut", "m", 0.02, 0.34)
    ] = (0.24, 0.27)
    travel: Annotated[float, Setting("of a run; larger than the play", "m", 2e-4, 5e-3)] = 1e-3
    least_play: Annotated[float, Setting("smaller play counts as none", "m", 0.0, 1e-3)] = 1e-5


class ByMaps(NamedTuple):
    """The thesis's method: mean and standard deviation of the difference, twice the weight [N]."""

    mean: float
    deviation: float


def run(lab: Lab, settings: Settings) -> Result:
    """Weigh the moving parts; needs the result of friction_map.

    Quantity `gravity` comes from the play if there is one, else from the maps. Raises
    MissingResult, NotPossible if neither method has its data, and the errors of `Lab.run`.
    """
    validated(settings)
    maps = lab.result(friction_map.NAME).data
    jobs = _jobs(settings)
    parts = lab.run(NAME, jobs)
    crossings = [crossing(job.trial, parts[job.name], settings.least_play) for job in jobs]
    weight, by_maps = weighed(crossings), difference_of_maps(maps)
    if weight is None and by_maps is None:
        raise NotPossible(
            "the handle crosses no play, and friction_map has no run upside down: weight and "
            "friction cannot be separated; measure friction_map with inverted_speeds"
        )
    data = {"crossings": np.array(crossings), "jobs": np.array([job.name for job in jobs])}
    for job in jobs:
        for name in ("gap", "force"):
            data[f"{name}_{job.name}"] = parts[job.name][name]
    return Result(
        NAME,
        _quantities(weight, by_maps, crossings),
        settings._asdict(),
        _notes(weight, by_maps),
        data,
    )


def difference_of_maps(maps: dict[str, np.ndarray]) -> ByMaps | None:
    """Return force upright minus upside down over the lower half, all speeds, both ways (5.2.4).

    None without runs upside down.
    """
    beyond = [
        (maps[way] - maps[f"{way}_inverted"])[:, _LOWER].ravel() for way in ("up", "down")
    ]
    values = np.concatenate(beyond)
    values = values[np.isfinite(values)]
    return ByMaps(float(values.mean()), float(values.std())) if len(values) else None


def _jobs(settings: Settings) -> list[Job]:
    jobs = []
    for inverted in (False, True):
        for number, height in enumerate(settings.heights):
            for speed in settings.speeds:
                for name, way in (("up", 1.0), ("down", -1.0)):
                    end = float(height) + way * settings.travel
                    trial = StageTrial(way * float(speed), float(height), end, inverted)
                    name = f"{name}{'_inverted' if inverted else ''}_{number}_{speed * 1e6:.0f}um_s"
                    jobs.append(Job(name, trial, traced))
    return jobs


def _quantities(
    weight: Weight | None, by_maps: ByMaps | None, crossings: list[Crossing]
) -> tuple[Quantity, ...]:
    quantities = []
    if weight is None:
        widest = max(abs(c.width) for c in crossings)
        quantities.append(Quantity("play", 0.0, widest, "m", "backlash, none was seen"))
    if weight:
        play = play_width(crossings, counts_to_height(1))
        quantities += [
            Quantity("gravity", weight.weight, weight.error, "N", "weight, across the play"),
            Quantity("film", weight.film, weight.film_error, "N s/m", "drag of the grease film"),
            Quantity("play", *play, "m", "backlash between nut and handle"),
        ]
    elif by_maps:
        quantities.append(
            Quantity("gravity", by_maps.mean / 2.0, by_maps.deviation / 2.0, "N", "weight, by maps")
        )
    if by_maps:
        quantities += [
            Quantity("double_weight", *by_maps, "N", "upright minus upside down, lower half"),
            Quantity(
                "gravity_thesis", by_maps.mean / 2.0, by_maps.deviation / 2.0, "N",
                "weight by the thesis's method",
            ),
        ]  # fmt: skip
    if weight and by_maps:
        bias = by_maps.mean / 2.0 - weight.weight
        quantities.append(
            Quantity("bias_thesis", bias, weight.error, "N", "thesis's method minus ours")
        )
    return tuple(quantities)


def _notes(weight: Weight | None, by_maps: ByMaps | None) -> tuple[str, ...]:
    notes = []
    if weight is None:
        notes.append(
            "The handle crossed no play (none, or smaller than least_play). The weight comes from "
            "the maps, with an error of half the difference between friction against and with "
            "gravity."
        )
    else:
        if np.isnan(weight.film):
            notes.append("One speed and direction only: the weight includes the film's drag.")
        if np.isnan(weight.zero):
            notes.append("The transducer's zero is the one that the bench subtracted.")
    if weight and by_maps:
        bias = by_maps.mean / 2.0 - weight.weight
        notes.append(
            f"The thesis's method has an error of {bias:+.2f} N here: half of the mean difference "
            "between friction against and with gravity, in the lower half of the screw."
        )
    if by_maps is None:
        notes.append("There are no runs upside down, which the thesis's method needs.")
    return tuple(notes)
