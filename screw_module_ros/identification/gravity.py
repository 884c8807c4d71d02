# SPDX-License-Identifier: Apache-2.0
"""Weight of the parts that move up and down, by two methods (thesis 5.2.4, figs 5-20 to 5-23).

The thesis takes half of the mean difference between runs upright and upside down in the lower half
of the screw. That is exact only if friction against gravity equals friction with gravity. The
thesis found that they differ; half of the difference is an error of its weight.

Our method measures the weight across the play. At rest the handle touches the nut on one side of
the play. While the stage creeps to the other side, handle and nut have no contact: the transducer
measures the weight of the moving parts and the drag of the grease film, which is proportional to
the speed, but no friction of the screw. The encoder measures the nut, which stands still during the
crossing, so stage travel minus nut travel shows its beginning, its end and its width.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from ..geometry import counts_to_height
from ..settings import Setting
from . import friction_map
from .figures import COLOURS, DESIRED, axes_for
from .lab import Lab, Part
from .results import STAGE, Drawn, Experiment, Published, Quantity, Result, beside
from .stage_runs import LOWER_HALF
from .trials import DIRECTIONS, NotPossible, Samples, StageTrial

NAME = "gravity"
THESIS = {
    "gravity": Published("weight", 0.53, given_to_plant=True),
    "double_weight": Published("double_weight", 2.1, given_to_plant=True),
}
_INNER = (0.2, 0.8)  # of the play: clear of the contacts at both sides
_FEWEST = 8  # samples that make a plateau
_UNEVEN = 0.5  # change of the force across a plateau that indicates contact [N]


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


class Crossing(NamedTuple):
    """Result of one run.

    sign: +1 upright, -1 upside down; direction: +1 up, -1 down the screw; speed: of the stage
    [m/s]; width: handle relative to nut, from rest to steady motion [m]; rate: the handle's speed
    relative to the nut during the crossing [m/s]; force: its mean during the crossing [N]; error:
    standard error of that mean [N]; both NaN without a crossing.
    """

    sign: float
    direction: float
    speed: float
    width: float
    rate: float
    force: float
    error: float


class Weight(NamedTuple):
    """weight [N]; film: drag [N s/m]; error, film_error: their standard errors; zero: of the
    transducer [N]. film and zero are NaN if the runs do not determine them. spread: of the forces
    about the fit, relative to their standard errors.
    """

    weight: float
    error: float
    film: float
    film_error: float
    zero: float
    spread: float


def run(lab: Lab, settings: Settings) -> Result:
    """Weigh the moving parts; needs the result of friction_map.

    Quantity `gravity` comes from the play if there is one, else from the maps. Raises
    MissingResult, NotPossible if neither method has its data, and the errors of `Lab.record`.
    """
    maps = lab.result(friction_map.NAME).data
    trials = _trials(settings)
    parts = lab.record(NAME, trials, traced)
    crossings = [
        crossing(trial, parts[name], settings.least_play) for name, trial in trials.items()
    ]
    seen = [c for c in crossings if np.isfinite(c.force)]
    weight = weighed(seen) if seen else None
    quantities, notes = [], []
    if weight:
        quantities += [
            Quantity("gravity", weight.weight, weight.error, "N", "weight, across the play"),
            Quantity("film", weight.film, weight.film_error, "N s/m", "drag of the grease film"),
            Quantity("play", *play_width(seen, counts_to_height(1)), "m",
                     "backlash between nut and handle"),
        ]  # fmt: skip
        if np.isnan(weight.film):
            notes.append("One speed and direction only: the weight includes the film's drag.")
        if np.isnan(weight.zero):
            notes.append("The transducer's zero is the one that the bench subtracted.")
    else:
        widest = max(abs(c.width) for c in crossings)
        quantities.append(Quantity("play", 0.0, widest, "m", "backlash, none was seen"))
        notes.append(
            "The handle crossed no play (none, or smaller than least_play). The weight comes from "
            "the maps, with an error of half the difference between friction against and with "
            "gravity."
        )
    values = np.concatenate([
        (maps[way] - maps[f"{way}_inverted"])[:, LOWER_HALF].ravel() for way in ("up", "down")
    ])  # fmt: skip
    values = values[np.isfinite(values)]
    if len(values):  # twice the weight: upright minus upside down, all speeds, both ways (5.2.4)
        mean, deviation = float(values.mean()), float(values.std())
        half = (mean / 2.0, deviation / 2.0, "N")
        if weight is None:
            quantities.append(Quantity("gravity", *half, "weight, by maps"))
        quantities += [
            Quantity("double_weight", mean, deviation, "N",
                     "upright minus upside down, lower half"),
            Quantity("gravity_thesis", *half, "weight by the thesis's method"),
        ]  # fmt: skip
        if weight:
            bias = mean / 2.0 - weight.weight
            quantities.append(
                Quantity("bias_thesis", bias, weight.error, "N", "thesis's method minus ours")
            )
            notes.append(
                f"The thesis's method has an error of {bias:+.2f} N here: half of the mean "
                "difference between friction against and with gravity, in the lower half of the "
                "screw."
            )
    elif weight is None:
        raise NotPossible(
            "the handle crosses no play, and friction_map has no run upside down: weight and "
            "friction cannot be separated; measure friction_map with inverted_speeds"
        )
    else:
        notes.append("There are no runs upside down, which the thesis's method needs.")
    data = {"crossings": np.array(crossings), "jobs": np.array(list(trials))}
    data |= {f"{name}_{trial}": parts[trial][name] for trial in trials for name in ("gap", "force")}
    return Result(NAME, beside(THESIS, quantities), settings._asdict(), tuple(notes), data)


def _trials(settings: Settings) -> dict[str, StageTrial]:
    return {
        f"{name}{'_inverted' if inverted else ''}_{number}_{speed * 1e6:.0f}um_s": StageTrial(
            way * float(speed), float(height), float(height) + way * settings.travel, inverted
        )
        for inverted in (False, True)
        for number, height in enumerate(settings.heights)
        for speed in settings.speeds
        for name, way in DIRECTIONS
    }


def traced(trial: StageTrial, samples: Samples) -> Part:
    """Reduce a creeping run to `gap` (handle relative to nut [m]), `force` [N] and `time` [s]."""
    direction = np.sign(trial.speed)
    stage = abs(trial.speed) * samples.time
    gap = stage - direction * (samples.position - samples.position[0])
    moving = stage <= abs(trial.end - trial.start)
    return {"gap": gap[moving], "force": samples.force[moving], "time": samples.time[moving]}


def crossing(trial: StageTrial, part: Part, least: float) -> Crossing:
    """Evaluate a run reduced by `traced`; least: smaller play counts as none [m]."""
    gap, force, time = part["gap"], part["force"], part["time"]
    width = float(np.median(gap[-max(len(gap) // 4, 1) :]))
    direction = float(np.sign(trial.speed))
    sign = -1.0 if trial.upside_down else 1.0
    nothing = Crossing(sign, direction, abs(trial.speed), width, np.nan, np.nan, np.nan)
    first, last = (int(np.argmax(gap >= share * width)) for share in _INNER)
    if width < least or last - first < _FEWEST:
        return nothing
    inside = slice(first, last)
    level = force[inside]
    half = len(level) // 2
    error = float(level.std(ddof=1) / np.sqrt(len(level)))
    uneven = abs(float(level[:half].mean() - level[half:].mean()))
    if uneven > max(_UNEVEN, 6.0 * error):
        return nothing
    rate = float(np.polyfit(time[inside], gap[inside], 1)[0])
    return nothing._replace(rate=rate, force=float(level.mean()), error=error)


def weighed(seen: list[Crossing]) -> Weight:
    """Return the best fit of the weight to the crossings that were seen.

    force = sign weight + direction film rate + zero, weighted least squares. If the runs do not
    determine all three (one orientation, one speed), the fit omits the zero, which the bench has
    subtracted, and then the film.
    """
    terms = np.array([(c.sign, c.direction * c.rate, 1.0) for c in seen])
    terms[:, 1] *= 1e3  # mm/s, so that all columns are of one size
    force, error = np.array([(c.force, c.error) for c in seen]).T
    used = next(n for n in (3, 2, 1) if np.linalg.matrix_rank(terms[:, :n], tol=0.1) == n)
    matrix = terms[:, :used] / error[:, None]
    values, *_ = np.linalg.lstsq(matrix, force / error, rcond=None)
    spare = len(seen) - used
    misfit = ((matrix @ values - force / error) ** 2).sum()
    spread = float(np.sqrt(misfit / spare)) if spare else 1.0
    errors = np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix))) * max(spread, 1.0)
    (weight, film, zero), (error, film_error, _) = (
        np.pad(found, (0, 3 - used), constant_values=np.nan).tolist() for found in (values, errors)
    )
    return Weight(weight, error, film * 1e3, film_error * 1e3, zero, spread)


def play_width(seen: list[Crossing], resolution: float) -> tuple[float, float]:
    """Return the play and its standard error [m], from the widths of the crossings seen.

    The fit of a line over the speed removes the effect of a late start of the stage. resolution: of
    the encoder [m].
    """
    speed, width = np.array([(c.speed, c.width) for c in seen]).T
    quantised = resolution / np.sqrt(6.0)  # of a difference of two counts
    if len(set(speed)) < 2 or len(seen) < 4:
        return float(width.mean()), float(np.hypot(width.std(), quantised))
    line, cov = np.polyfit(speed, width, 1, cov="unscaled")
    left = width - np.polyval(line, speed)
    spread = max(float(np.sqrt((left**2).sum() / (len(seen) - 2))), quantised)
    return float(line[1]), float(spread * np.sqrt(cov[1, 1]))


def draw(result: Result) -> Drawn:
    """Return the figure of the force while the handle crosses the play (ours)."""
    figure, axes = axes_for("handle against nut [mm]", "force, against gravity positive [N]",
                            "Weight while the handle crosses the play")  # fmt: skip
    speeds = sorted({float(row[2]) for row in result.data["crossings"]})
    named = set()
    for name, row in zip(result.data["jobs"], result.data["crossings"], strict=True):
        sign, _, speed, _, _, force, _ = row
        if np.isfinite(force):
            axes.plot(
                result.data[f"gap_{name}"] * 1e3, sign * result.data[f"force_{name}"], ".",
                markersize=2.0, alpha=0.35, color=COLOURS[speeds.index(speed) % len(COLOURS)],
                label=None if speed in named else f"{speed * 1e3:g} mm/s",
            )  # fmt: skip
            named.add(speed)
    weight = result.value("gravity")
    axes.axhline(weight, color=DESIRED, linestyle="--", label=f"weight, {weight:.2f} N")
    thesis = THESIS["gravity"]
    axes.axhspan(thesis.value - thesis.tolerance, thesis.value + thesis.tolerance,
                 color="#eeeeee", zorder=0, label=f"{thesis.value:g} N of 5.2.4 and its scatter")
    axes.legend(loc="lower right", markerscale=5.0)
    return {"play": figure}


EXPERIMENT = Experiment(
    NAME, "weight of the parts that move up and down, by two methods (thesis 5.2.4)", Settings,
    run, draw, STAGE, ("friction_map",),
)  # fmt: skip
