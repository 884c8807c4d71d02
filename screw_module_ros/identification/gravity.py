# SPDX-License-Identifier: Apache-2.0
"""Weight of the parts that move up and down, by two methods (thesis 5.2.4, figs 5-20 to 5-23).

The thesis takes half of the mean difference between runs upright and upside down in the lower half
of the screw. That is exact only if friction against gravity equals friction with gravity. The
thesis found that they differ; half of the difference is an error of its weight.

Our method measures the weight across the play. At rest the handle touches the nut on the side of
the play to which gravity pulls. The stage lifts it off, creeps to the other side, where it moves
the nut, and creeps back. During both crossings handle and nut have no contact: the transducer
measures the weight of the moving parts, the drag of the grease film, which is proportional to the
speed, and the friction of the handle's own guide and cable, but no friction of the screw. Drag and
friction change their sign with the direction: half the sum of both crossings is the weight, half
the difference is what rubs, and its dependence on the speed tells film and guide apart. A run that
crosses against gravity alone takes the guide's friction for weight.

The encoder measures the nut, which stands still during a crossing, so stage travel minus nut travel
shows where it is. The play is the gap between both contacts without load: lines of the gap over the
force of each contact, since contact and support of the screw deflect under it.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from ..geometry import Screw, counts_to_height
from ..settings import Setting
from . import friction_map
from .figures import COLOURS, DESIRED, axes_for
from .lab import Lab, Part
from .results import (
    STAGE,
    Drawn,
    Experiment,
    Published,
    Quantity,
    Result,
    beside,
    from_sources,
)
from .stage_runs import LOWER_HALF
from .trials import NotPossible, Samples, StageTrial
from .uncertainty import TRANSDUCER, TRANSDUCER_ERROR, Source, bounded

NAME = "gravity"
THESIS = {
    "gravity": Published("weight", 0.53, given_to_plant=True),
    "double_weight": Published("double_weight", 2.1, given_to_plant=True),
}
_INNER = (0.5, 0.9)
"""Shares of the play: clear of the contacts, after the nut's swing from the first."""
_FEWEST = 8  # samples that make a plateau
_UNEVEN = 0.5  # change of the force across a plateau that indicates contact [N]
_LEAST_LOADED = 4  # samples for the line of a contact
_STARTED_S = 0.003  # the stage has its speed
_LOADED = 0.3  # share of a contact's largest force at which it is surely touched
_DRIVEN = 0.9  # share of the way: the stage does not brake yet
_TOLD_APART = 0.1  # least spread of the speeds for the film's drag [mm/s]
_FRICTION_DIFFERS = 0.25  # friction against gravity from friction with it, at most (as a share)


class Settings(NamedTuple):
    """The creeping runs; the maps come from friction_map."""

    speeds: Annotated[
        tuple[float, ...], Setting("of the stage across the play", "m/s", 1e-4, 5e-3)
    ] = (0.00025, 0.0005, 0.001, 0.002)
    heights: Annotated[
        tuple[float, ...], Setting("start of the runs; friction holds the nut", "m", 0.02, 0.34)
    ] = (0.24, 0.27)
    travel: Annotated[float, Setting("of a run; larger than the play", "m", 2e-4, 5e-3)] = 1e-3
    least_play: Annotated[float, Setting("smaller play counts as none", "m", 0.0, 1e-3)] = 1e-5


class Crossing(NamedTuple):
    """Result of one way of a run.

    sign: +1 upright, -1 upside down; direction: +1 up, -1 down the screw; speed: of the stage
    [m/s]; width: handle relative to nut, from rest to steady motion [m]; rate: the handle's speed
    relative to the nut during the crossing [m/s]; force: its mean during the crossing [N]; error:
    standard error of that mean [N]; play: gap between the contacts without load [m]; play_error:
    its standard error [m]; compliance: of a contact with what holds it [m/N]. The last six are NaN
    without a crossing.
    """

    sign: float
    direction: float
    speed: float
    width: float
    rate: float = np.nan
    force: float = np.nan
    error: float = np.nan
    play: float = np.nan
    play_error: float = np.nan
    compliance: float = np.nan


class Line(NamedTuple):
    """Weighted fit of values = level + slope x: both with their sources of uncertainty.

    slope: NaN where x does not vary enough to determine it.
    """

    level: float
    level_error: Source
    slope: float
    slope_error: Source


def run(lab: Lab, settings: Settings) -> Result:
    """Weigh the moving parts; needs the result of friction_map.

    Quantity `gravity` comes from the play if there is one, else from the maps. Raises
    MissingResult, NotPossible if neither method has its data, and the errors of `Lab.record`.
    """
    maps = lab.result(friction_map.NAME).data
    trials = _trials(settings)
    parts = lab.record(NAME, trials, traced)
    crossings = [
        (crossing(trial, parts[name], settings.least_play, 0),
         crossing(trial, parts[name], settings.least_play, 1))
        for name, trial in trials.items()
    ]  # fmt: skip
    seen = [pair for pair in crossings if all(np.isfinite(c.force) for c in pair)]
    quantities, notes = _across(lab, seen) if seen else _no_play(crossings)
    values = np.concatenate([
        (maps[way] - maps[f"{way}_inverted"])[:, LOWER_HALF].ravel() for way in ("up", "down")
    ])  # fmt: skip
    values = values[np.isfinite(values)]
    if len(values):  # twice the weight: upright minus upside down, all speeds, both ways (5.2.4)
        mean, deviation = float(values.mean()), float(values.std())
        friction = float(np.nanmean(maps["up"] - maps["down"])) / 2.0
        by_maps = (
            Source("scatter of the bins, whose errors are common to neighbours", deviation / 2.0),
            bounded("friction against and with gravity differ; this method cannot see by how much: "
                    f"a bound of {_FRICTION_DIFFERS:.0%}, the thesis's maps differ by 12 %",
                    0.5 * _FRICTION_DIFFERS * friction),
        )  # fmt: skip
        if not seen:
            quantities.append(from_sources("gravity", mean / 2.0, by_maps, "N", "weight, by maps"))
        quantities += [
            Quantity("double_weight", mean, deviation, "N",
                     "upright minus upside down, lower half"),
            from_sources("gravity_thesis", mean / 2.0, by_maps, "N",
                         "weight by the thesis's method"),
        ]  # fmt: skip
        if seen:
            bias = mean / 2.0 - quantities[0].value
            quantities.append(
                Quantity("bias_thesis", bias, quantities[0].uncertainty, "N",
                         "thesis's method minus ours")
            )  # fmt: skip
            notes.append(
                f"The thesis's method has an error of {bias:+.2f} N here: half of the mean "
                "difference between friction against and with gravity, in the lower half of the "
                "screw."
            )
    elif not seen:
        raise NotPossible(
            "the handle crosses no play, and friction_map has no run upside down: weight and "
            "friction cannot be separated; measure friction_map with inverted_speeds"
        )
    else:
        notes.append("There are no runs upside down, which the thesis's method needs.")
    ways = [one for pair in crossings for one in pair]
    jobs = [f"{name}_{way}" for name in trials for way in ("out", "back")]
    data = {"crossings": np.array(ways), "jobs": np.array(jobs)}
    data |= {
        f"{key}_{trial}_{way}": parts[trial][key][number]
        for trial in trials
        for key in ("gap", "force")
        for number, way in enumerate(("out", "back"))
    }  # fmt: skip
    return Result(NAME, beside(THESIS, quantities), settings._asdict(), tuple(notes), data)


def _across(
    lab: Lab, seen: list[tuple[Crossing, Crossing]]
) -> tuple[list[Quantity], list[str]]:
    """Return what the crossings of the play tell, and notes."""
    halves, rubs = weighed(seen), rubbing(seen)
    notes = [
        f"Crossings against gravity alone would give a weight {rubs.level:.2f} N too large: the "
        "friction of the handle's guide.",
    ]
    # Coulomb: the guide may rub in proportion to its load, which is the moment of the stage's
    # force, weight + guide one way and weight - guide the other. Nothing here measures it.
    uneven = rubs.level**2 / halves.level
    sources = halves.level_error, *lab.real(
        bounded("the guide may rub more under the larger load of the way against gravity", uneven),
        bounded(TRANSDUCER, TRANSDUCER_ERROR * halves.level),
    )
    way = (_INNER[1] - _INNER[0]) * float(np.median([c.width for pair in seen for c in pair]))
    counted = bounded("half a count of the encoder in the way across the play",
                      0.5 * counts_to_height(1, lab.stand.screw) / way * rubs.slope)  # fmt: skip
    quantities = [
        from_sources("gravity", halves.level, sources, "N", "weight, across the play"),
        from_sources("guide", rubs.level, (rubs.level_error,), "N",
                     "friction of guide and cable, on the handle's side of the play"),
        from_sources("film", rubs.slope, (rubs.slope_error, counted), "N s/m",
                     "drag of the grease film"),
        _play(seen, rubs.level, lab.stand.screw),
    ]  # fmt: skip
    if np.isnan(rubs.slope):
        notes.append("One speed only: the friction of the guide includes the film's drag.")
    if np.isnan(halves.slope):
        notes.append("The transducer's zero is the one that the stand subtracted.")
    return quantities, notes


def _no_play(crossings: list[tuple[Crossing, Crossing]]) -> tuple[list[Quantity], list[str]]:
    widest = max(abs(c.width) for pair in crossings for c in pair)
    return [Quantity("play", 0.0, widest, "m", "backlash, none was seen")], [
        "The handle did not cross a play both ways (none, or smaller than least_play). The weight "
        "comes from the maps, with an error of half the difference between friction against and "
        "with gravity."
    ]


def _trials(settings: Settings) -> dict[str, StageTrial]:
    """Return the runs, each away from the side on which the handle rests, and back."""
    return {
        f"{name}_{number}_{speed * 1e6:.0f}um_s": StageTrial(
            away * float(speed), float(height), float(height) + away * settings.travel,
            upside_down=away < 0.0, back=True,
        )
        for name, away in (("upright", 1.0), ("inverted", -1.0))
        for number, height in enumerate(settings.heights)
        for speed in settings.speeds
    }  # fmt: skip


def traced(trial: StageTrial, samples: Samples) -> Part:
    """Reduce a run to `gap` (handle relative to nut [m]), `force` [N] and `time` [s].

    Each has a row for the way out and one for the way back, from where the stage begins to move.
    """
    length = len(samples.time) // len(trial.ways)
    time = samples.time[:length]
    stage = abs(trial.speed) * time
    moving = stage <= _DRIVEN * abs(trial.end - trial.start)
    rows = []
    for number, (speed, _) in enumerate(trial.ways):
        way = slice(number * length, (number + 1) * length)
        nut = np.sign(speed) * (samples.position[way] - samples.position[way.start])
        rows.append(((stage - nut)[moving], samples.force[way][moving], time[moving]))
    return dict(zip(("gap", "force", "time"), map(np.array, zip(*rows, strict=True)), strict=True))


def crossing(trial: StageTrial, part: Part, least: float, way: int) -> Crossing:
    """Evaluate a way of a run reduced by `traced`; least: smaller play counts as none [m]."""
    gap, force, time = (part[name][way] for name in ("gap", "force", "time"))
    speed = trial.ways[way][0]
    width = float(np.median(gap[-max(len(gap) // 4, 1) :]))
    sign = -1.0 if trial.upside_down else 1.0
    nothing = Crossing(sign, float(np.sign(speed)), abs(speed), width)
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
    # The mean over the same samples as the force: the nut still swings when a fast crossing begins.
    rate = float((gap[last] - gap[first]) / (time[last] - time[first]))
    mean = float(level.mean())
    (near, near_error, soft), (far, far_error, firm) = (
        contact(gap[side], force[side] - mean, time[side] > _STARTED_S)
        for side in (slice(first), slice(last, None))
    )
    return nothing._replace(
        rate=rate, force=mean, error=error, play=far - near,
        play_error=float(np.hypot(near_error, far_error)), compliance=0.5 * (soft + firm),
    )  # fmt: skip


def contact(
    gap: np.ndarray, beyond: np.ndarray, steady: np.ndarray
) -> tuple[float, float, float]:
    """Return the gap [m] at which a contact carries nothing, its error, and its compliance [m/N].

    beyond: force beyond the plateau at these gaps [N]; steady: where the stage has its speed. A
    loaded contact and the screw's support deflect in proportion to it: the gap of any loaded sample
    would be too far out. NaN if too few samples are loaded.
    """
    loaded = steady & (np.abs(beyond) > _LOADED * float(np.abs(beyond).max(initial=0.0)))
    if np.count_nonzero(loaded) < _LEAST_LOADED or np.ptp(beyond[loaded]) < _UNEVEN:
        return np.nan, np.nan, np.nan
    (slope, unloaded), cov = np.polyfit(beyond[loaded], gap[loaded], 1, cov=True)
    return float(unloaded), float(np.sqrt(cov[1, 1])), abs(float(slope))


def weighed(seen: list[tuple[Crossing, Crossing]]) -> Line:
    """Return the weight [N] as the level, and the transducer's zero as the slope over the sign.

    Half of the sum of both ways of a run is sign x weight + zero; the zero is NaN, and counted as
    none, with runs of one orientation only.
    """
    sign = np.array([out.sign for out, _ in seen])
    half = sign * np.array([0.5 * (out.force + back.force) for out, back in seen])
    return _line(sign, half, _errors(seen), 0.5, "scatter of the runs about the fit of the weight")


def rubbing(seen: list[tuple[Crossing, Crossing]]) -> Line:
    """Return the guide's friction [N] as the level and the film's drag [N s/m] as the slope.

    Half of the difference of both ways of a run is friction + drag x rate.
    """
    rate = np.array([1e3 * 0.5 * (out.rate + back.rate) for out, back in seen])  # [mm/s]
    half = np.array([0.5 * out.direction * (out.force - back.force) for out, back in seen])
    what = "scatter of the runs about the line over the speed"
    line = _line(rate, half, _errors(seen), _TOLD_APART, what)
    slope = line.slope_error._replace(standard=1e3 * line.slope_error.standard)
    return line._replace(slope=1e3 * line.slope, slope_error=slope)


def _play(
    seen: list[tuple[Crossing, Crossing]], guide: float, screw: Screw
) -> Quantity:
    """Return the play [m] at speed zero, by a line over the speed; guide: its friction [N].

    Only the ways back count: the stage has pushed the nut before, so that both contacts are loaded,
    while at rest stage and nut share the weight in any proportion. The line removes the effect of
    what damps the contacts.
    """
    ways = [back for _, back in seen if np.isfinite(back.play)]
    if not ways:
        return Quantity("play", float(np.median([back.width for _, back in seen])), np.nan, "m",
                        "backlash between nut and handle, deflection of the contacts included")
    speed, play, error = (
        np.array([getattr(c, name) for c in ways]) for name in ("speed", "play", "play_error")
    )
    line = _line(1e3 * speed, play, error, _TOLD_APART,
                 "scatter of the crossings about the line over the speed")  # fmt: skip
    compliance = float(np.median([c.compliance for c in ways]))
    sources = (
        line.level_error,
        bounded("twice the guide's friction, on its way to slip, on the contact that is left",
                2.0 * guide * compliance),
        bounded("half a count of the encoder: the nut moves by few while a contact is unloaded",
                0.5 * counts_to_height(1, screw)),
    )  # fmt: skip
    return from_sources("play", line.level, sources, "m", "backlash between nut and handle")


def _errors(seen: list[tuple[Crossing, Crossing]]) -> np.ndarray:
    """Return the standard error of half the sum or difference of each pair of forces [N]."""
    return np.array([0.5 * np.hypot(out.error, back.error) for out, back in seen])


def _line(x: np.ndarray, y: np.ndarray, error: np.ndarray, least: float, what: str) -> Line:
    """Fit y = level + slope x by weighted least squares.

    least: smallest standard deviation of x that determines a slope. The standard errors are those
    of the scatter about the fit where it is larger than `error` tells.
    """
    used = 2 if len(x) > 2 and x.std() > least else 1
    terms = np.column_stack((np.ones_like(x), x))[:, :used] / error[:, None]
    values, *_ = np.linalg.lstsq(terms, y / error, rcond=None)
    spare = len(x) - used
    spread = np.sqrt(((terms @ values - y / error) ** 2).sum() / spare) if spare else 1.0
    errors = np.sqrt(np.diag(np.linalg.inv(terms.T @ terms))) * max(float(spread), 1.0)
    (level, slope), (level_error, slope_error) = (
        np.pad(found, (0, 2 - used), constant_values=np.nan).tolist() for found in (values, errors)
    )
    sources = (Source(what, one, spare or np.inf) for one in (level_error, slope_error))
    return Line(level, next(sources), slope, next(sources))


def draw(result: Result) -> Drawn:
    """Return the figure of the force while the handle crosses the play (ours)."""
    figure, axes = axes_for("handle against nut, from rest [mm]",
                            "force, against gravity positive [N]",
                            "Weight across the play; dots: against gravity, crosses: with it")
    ways = [Crossing(*row) for row in result.data["crossings"]]
    speeds, named = sorted({way.speed for way in ways}), set()
    for name, way in zip(result.data["jobs"], ways, strict=True):
        if not np.isfinite(way.force):
            continue
        against = way.sign * way.direction > 0.0
        label = f"{way.speed * 1e3:g} mm/s"
        axes.plot(
            result.data[f"gap_{name}"] * 1e3, way.sign * result.data[f"force_{name}"],
            "." if against else "+", markersize=2.0 if against else 3.0, alpha=0.35,
            color=COLOURS[speeds.index(way.speed) % len(COLOURS)],
            label=None if label in named else label,
        )  # fmt: skip
        named.add(label)
    weight = result.quantity("gravity")
    axes.axhline(weight.value, color=DESIRED, linestyle="--",
                 label=f"weight, {weight.value:.3f} ± {weight.uncertainty:.3f} N")  # fmt: skip
    thesis = THESIS["gravity"]
    axes.axhspan(thesis.value - thesis.tolerance, thesis.value + thesis.tolerance,
                 color="#eeeeee", zorder=0, label=f"{thesis.value:g} N of 5.2.4 and its scatter")
    axes.legend(loc="lower center", markerscale=4.0, ncols=2)
    return {"play": figure}


EXPERIMENT = Experiment(
    NAME, "weight of the parts that move up and down, by two methods (thesis 5.2.4)", Settings,
    run, draw, STAGE, ("friction_map",),
)  # fmt: skip
