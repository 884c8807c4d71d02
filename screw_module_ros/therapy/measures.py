# SPDX-License-Identifier: Apache-2.0
"""The one table of what is measured on a trial: names, units, definitions and computation.

The names are those of TrialResult.msg and of the CSV. pm1 (`initiated`) to pm4 are the measures
that the adaptation uses (krebs2003). The definitions name authors and year; the works are
rohrer2002, balasubramanian2012, balasubramanian2015 and dipietro2007 of docs/references.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..control.minimum_jerk import PEAK_SPEED
from .columns import Trial
from .kinematics import (
    direction_error,
    ellipse_area,
    hold_deviation,
    hull_area,
    independence,
    path_error,
    path_ratio,
    ratio,
    speed_peaks,
    time_in_motion,
)
from .protocol import CIRCLE, GAME, HOLD, KINDS, REACH, RESISTED, STRENGTH
from .smoothness import JERK_CUTOFF, dimensionless_jerk, log_dimensionless_jerk, sparc

Row = dict[str, Any]
"""Result of a trial by name, in SI units: `COLUMNS`, and `start`, `target`, `started_ns`,
`ended_ns`. NaN if a kind of trial has no value."""


def _mean(values: Sequence[float]) -> float:
    """Return the mean, zero of nothing, which changes no assistance."""
    return math.fsum(values) / len(values) if values else 0.0


def _largest(values: Iterable[float]) -> float:
    """Return the largest number, NaN without one; samples without a valid force are NaN."""
    return max((value for value in values if math.isfinite(value)), default=math.nan)


def _power_behind(trial: Trial) -> float:
    pairs = zip(trial.during, trial.leads, strict=True)
    return _mean([trial.power(sample) for sample, lead in pairs if lead < 0.0])


def _hold_deviation(trial: Trial) -> float:
    return hold_deviation(np.array([trial.on_axes(s.position) for s in trial.during]),
                          trial.ends[0])  # fmt: skip


EFFORT_MASS = 6.5  # [kg] ours: module and plane at the handle (params/plant.yaml)
EFFORT_FRICTION = 0.8  # [N] ours: of the plane at the handle, in the middle of its range
EFFORT_TIME = 3.0  # [s] ours: the slowest wall of an adaptation
RESTING = 0.05  # [s] ours: less than any reaction


def _effort(trial: Trial) -> float:
    """Return the patient's mean force along the line over what the path needs; docs/therapy.md."""
    behind = (s.time_ns for s, lead in zip(trial.during, trial.leads, strict=True) if lead < 0.0)
    touched_ns = next(behind, trial.end_ns)
    shown_ns = trial.samples[0].time_ns
    force = [trial.line.along(s.force) for s in trial.samples if s.time_ns <= touched_ns]
    resting = [trial.line.along(s.force) for s in trial.samples
               if s.time_ns - shown_ns <= RESTING * 1e9]  # fmt: skip
    mean_acceleration = 2.0 * PEAK_SPEED * trial.line.length / EFFORT_TIME**2
    needed = EFFORT_MASS * mean_acceleration + EFFORT_FRICTION
    return (_mean(force) - _mean(resting)) / needed


def _of_smooth(measure: Callable[[np.ndarray, float], float], trial: Trial) -> float:
    """Return a measure with derivatives of the speed, NaN if the rate is too low for it."""
    speed = trial.smooth_speed
    return measure(speed, trial.rate) if np.all(np.isfinite(speed)) else math.nan


class Measure(NamedTuple):
    """One measure.

    label, unit: as displayed; factor: from SI to this unit; kinds: of trials that have it;
    of: computes it from a trial, None if the course of the trial has it; text: the definition.
    """

    name: str
    label: str
    unit: str
    factor: float
    kinds: tuple[str, ...]
    of: Callable[[Trial], float] | None
    text: str

    def value(self, trial: Trial) -> float:
        """Return its value of a trial [SI], NaN if the trial has none.

        What only trials with a movement have, is NaN where the hand did not move.
        """
        missing = trial.cut is None and set(self.kinds) <= set(PLAYED)
        if missing or trial.kind not in self.kinds or self.of is None:
            return math.nan
        return self.of(trial)


MOVED, LINED = (REACH, CIRCLE, RESISTED), (REACH, RESISTED)
PLAYED, TESTED = (*MOVED, GAME), (*MOVED, HOLD, STRENGTH)
_SMOOTH = "It depends on the sampling rate, which the report states. Nearer to zero is smoother."
_MOVEMENT = "from the first to the last sample above a tenth of the peak speed"

MEASURES = (
    Measure(
        "initiated", "started by the patient", "", 1.0, KINDS, None,
        "The hand exceeded the start speed, or left the start, before the wait had passed (pm1).",
    ),
    Measure(
        "reached", "target reached", "", 1.0, KINDS, None,
        "The hand came within the hit radius of the target before the time limit of the trial.",
    ),
    Measure(
        "pm2a", "power while behind the wall", "W", 1.0, TESTED, _power_behind,
        "Mean of handle force times velocity along the line, over the samples in which the hand "
        "was behind the back wall; the force is the patient's on the robot, so it is negative "
        "where the robot moved the hand (Krebs et al. 2003).",
    ),
    Measure(
        "pm2b", "lead over the wall", "mm", 1e3, TESTED, lambda t: _mean(t.leads),
        "Mean of the hand's way along the line minus the back wall's, from start to end of the "
        "movement; after its duration the wall stays at the target.",
    ),
    Measure(
        "pm3", "mean square off the line", "mm²", 1e6, TESTED,
        lambda t: _mean([t.line.off(s.position) for s in t.during]),
        "Mean of the squared distance from the straight line, from start to end of the movement.",
    ),
    Measure(
        "pm4", "way along the line", "mm", 1e3, TESTED,
        lambda t: max([0.0, *(t.line.gone(s.position) for s in t.during)]),
        "Farthest the hand came along the line.",
    ),
    Measure(
        "duration", "duration", "s", 1.0, PLAYED, lambda t: t.speed.size / t.rate,
        f"Time {_MOVEMENT}.",
    ),
    Measure(
        "time_to_start", "time to start", "s", 1.0, MOVED,
        lambda t: float(t.times[t.movement.start]),
        "From the display of the target to the movement's first sample.",
    ),
    Measure(
        "mean_speed", "mean speed", "mm/s", 1e3, PLAYED, lambda t: float(t.speed.mean()),
        f"Mean speed {_MOVEMENT}.",
    ),
    Measure(
        "peak_speed", "peak speed", "mm/s", 1e3, PLAYED, lambda t: float(t.speed.max()),
        "Largest speed of the movement.",
    ),
    Measure(
        "speed_ratio", "mean over peak speed", "", 1.0, MOVED,
        lambda t: ratio(float(t.speed.mean()), float(t.speed.max())),
        "A minimum-jerk reach has 0.53; many stops make it less.",
    ),
    Measure(
        "speed_peaks", "speed peaks", "", 1.0, MOVED, lambda t: speed_peaks(t.speed),
        "Local maxima of the speed with a prominence of at least a twentieth of the peak speed.",
    ),
    Measure(
        "arrest_ratio", "time in motion", "%", 100.0, MOVED, lambda t: time_in_motion(t.speed),
        "Share of the movement's time in which the speed exceeds a tenth of its peak (movement "
        "arrest period ratio, Rohrer et al. 2002).",
    ),
    Measure(
        "sparc", "SPARC", "", 1.0, MOVED, lambda t: sparc(t.speed, t.rate),
        "Spectral arc length of the speed profile: cut-off 10 Hz, threshold 0.05, padding 4 "
        f"(Balasubramanian et al. 2012, 2015). {_SMOOTH}",
    ),
    Measure(
        "jerk", "dimensionless jerk", "", 1.0, MOVED,
        lambda t: _of_smooth(dimensionless_jerk, t),
        "-(T³/vpeak²) times the integral of the speed's squared second derivative; the speed is "
        f"that of positions behind a low pass without phase, of {JERK_CUTOFF:g} Hz. {_SMOOTH}",
    ),
    Measure(
        "log_jerk", "LDLJ", "", 1.0, MOVED, lambda t: _of_smooth(log_dimensionless_jerk, t),
        "-ln of the size of the dimensionless jerk. " + _SMOOTH,
    ),
    Measure(
        "path_error", "path error", "mm", 1e3, LINED, lambda t: path_error(t.path, *t.ends),
        "Mean distance of the hand from the straight line to the target.",
    ),
    Measure(
        "path_ratio", "path ratio", "", 1.0, LINED, lambda t: path_ratio(t.path, *t.ends),
        "Length of the hand's path over that of the straight line.",
    ),
    Measure(
        "direction_error", "initial direction error", "°", 57.29577951308232, LINED,
        lambda t: direction_error(t.path, *t.ends),
        "Angle between the line to the target and the direction to the hand's position after a "
        "fifth of the way.",
    ),
    Measure(
        "reach_error", "reach error", "mm", 1e3, (REACH,),
        lambda t: float(np.linalg.norm(t.path[-1] - np.asarray(t.ends[1]))),
        f"Distance from the target at the end of the movement ({_MOVEMENT}). It is not 0 for a "
        "target that was reached slowly, for instance by the push of the robot's wall afterwards.",
    ),
    Measure(
        "robot_share", "robot's share of the work", "%", 100.0, PLAYED,
        lambda t: ratio(t.work[1], t.work[0] + t.work[1]),
        "Work that the robot did on the hand over all work across the handle in both directions, "
        "on the protocol's axes. It includes mass and friction of the robot, so it is not zero "
        "without assistance.",
    ),
    Measure(
        "effort", "effort of the patient", "%", 100.0, (REACH,), _effort,
        "Mean of the patient's force along the line from the display of the target until the hand "
        "is behind the back wall, less his mean force in the first 50 ms, in which his arm at rest "
        "already pulls; over the force that takes the robot's mass (6.5 kg) and friction (0.8 N) "
        "along the line in 3 s (the mean of the accelerating half). An arm that does nothing has 0 "
        "or less, whoever reaches that slowly by himself about 100 %. Judged on the plane alone.",
    ),
    Measure(
        "patient_work", "work of the patient", "J", 1.0, PLAYED, lambda t: t.work[0],
        "Positive part of handle force times velocity, over time.",
    ),
    Measure(
        "robot_work", "work of the robot", "J", 1.0, PLAYED, lambda t: t.work[1],
        "Negative part of handle force times velocity, over time.",
    ),
    Measure(
        "independence", "independence of circles", "", 1.0, (CIRCLE,),
        lambda t: independence(t.path),
        "Small over large axis of the path's ellipse, from the covariance of x and y; a circle has "
        "1 (Dipietro et al. 2007).",
    ),
    Measure(
        "size", "size of circles", "cm²", 1e4, (CIRCLE,), lambda t: ellipse_area(t.path),
        "Area of the path's ellipse.",
    ),
    Measure(
        "work_area", "work area", "cm²", 1e4, (CIRCLE,), lambda t: hull_area(t.path),
        "Area of the convex hull of the hand's path in the plane.",
    ),
    Measure(
        "hold_deviation", "hold deviation", "mm", 1e3, (HOLD,), _hold_deviation,
        "Root mean square distance from the hold point.",
    ),
    Measure(
        "largest_force", "largest force", "N", 1.0, (STRENGTH,),
        lambda t: _largest(t.line.along(s.force) for s in t.during),
        "Largest force of the patient in the requested direction.",
    ),
    Measure(
        "largest_vertical_force", "largest vertical force", "N", 1.0, (STRENGTH,),
        lambda t: _largest(abs(s.fz) for s in t.during),
        "Largest vertical force of the patient, up or down.",
    ),
    Measure(
        "support", "support of the arm", "N", 1.0, KINDS, None,
        "Mean support of the arm's weight in use, upward on the hand. The controller tells it, not "
        "the hand's samples, so a replay does not compute it again.",
    ),
    Measure(
        "score", "score of the game", "%", 100.0, (GAME,), None,
        "What the game told last in this minute of how well the patient played. Each game says "
        "what it means by that, so scores of two games, or of two levels, do not compare. A replay "
        "does not compute it again.",
    ),
    Measure(
        "missing", "samples lost", "", 1.0, KINDS, None,
        "Missing samples between a trial's first and last one.",
    ),
)  # fmt: skip
DEFINITIONS = 3
"""Number of this table, raised when a column means something else, or the record keeps it
otherwise: the record is made again."""
BY_NAME = {measure.name: measure for measure in MEASURES}
COMPUTED = tuple(measure.name for measure in MEASURES if measure.of is not None)
COLUMNS = (
    "trial", "block", "circuit", "kind", "assisted", "slot_duration", "side_stiffness",
    "initiated", "reached", "moved", "first", "last", "samples", "missing", "rate", "support",
    "score", *COMPUTED,
)  # fmt: skip
"""Fields of a result without its points and stamps, in the order of the export."""


FILTERED = ("jerk", "log_jerk")
"""Measures behind a low pass, whose cut-off a result states; earlier versions had none."""


def computed(trial: Trial) -> dict[str, float]:
    """Return all computed measures of a trial by name [SI], NaN where it has none."""
    return {name: BY_NAME[name].value(trial) for name in COMPUTED}
