# SPDX-License-Identifier: Apache-2.0
"""The result of one trial, and its computation from the samples."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from .gaps import Gap, gaps_of
from .line import AXES, Line, speed_of
from .measures import Measures, measures
from .path import circle_figures, hold_deviation, path_figures
from .protocol import CIRCLE, HOLD, REACH, STRENGTH, TrialPlan
from .samples import HandSample
from .smoothness import dimensionless_jerk, log_dimensionless_jerk, sparc
from .speed import movement, speed_figures
from .work import work_done

_NAN = math.nan


class Figures(NamedTuple):
    """Figures of one movement, NaN if a kind of trial has no value; see `definitions`."""

    duration: float = _NAN
    time_to_start: float = _NAN
    mean_speed: float = _NAN
    peak_speed: float = _NAN
    speed_ratio: float = _NAN
    speed_peaks: float = _NAN
    arrest_ratio: float = _NAN
    sparc: float = _NAN
    jerk: float = _NAN
    log_jerk: float = _NAN
    path_error: float = _NAN
    path_ratio: float = _NAN
    direction_error: float = _NAN
    reach_error: float = _NAN
    robot_share: float = _NAN
    patient_work: float = _NAN
    robot_work: float = _NAN
    independence: float = _NAN
    size: float = _NAN
    hold_deviation: float = _NAN
    largest_force: float = _NAN
    largest_vertical_force: float = _NAN


class TrialResult(NamedTuple):
    """Result of one trial.

    plan, kind, assisted: of the trial; line: from start to target; duration [s], side_stiffness
    [N/m]: assistance; initiated: the patient started it; reached: the hand reached the target;
    moved: there was a movement; start_ns, end_ns: stamps of start and end [ns]; first, last:
    sequence numbers of its first and last sample; samples: number; rate: of the samples [Hz]; gaps:
    missing samples.
    """

    plan: TrialPlan
    kind: str
    assisted: bool
    line: Line
    duration: float
    side_stiffness: float
    initiated: bool
    reached: bool
    moved: bool
    start_ns: int
    end_ns: int
    first: int
    last: int
    samples: int
    rate: float
    gaps: tuple[Gap, ...]
    measures: Measures
    figures: Figures

    @property
    def missing(self) -> int:
        """Return the number of missing samples."""
        return sum(gap.missing for gap in self.gaps)


class Course(NamedTuple):
    """Course of a trial: stamps of start and end of the movement [ns].

    initiated: the patient started it; reached: the hand reached the target.
    """

    start_ns: int
    end_ns: int
    initiated: bool
    reached: bool


def trial_result(
    plan: TrialPlan,
    kind: str,
    assisted: bool,
    line: Line,
    duration: float,
    side_stiffness: float,
    course: Course,
    samples: Sequence[HandSample],
) -> TrialResult:
    """Return a trial's result. samples: from the display of the target to the trial's end."""
    times = np.array([s.time_ns - samples[0].time_ns for s in samples]) * 1e-9
    rate = float((len(samples) - 1) / times[-1]) if len(samples) > 1 and times[-1] > 0.0 else _NAN
    speed = np.array([speed_of(line.space, s) for s in samples])
    moving = movement(speed, rate) if rate > 0.0 else None
    during = [s for s in samples if course.start_ns <= s.time_ns <= course.end_ns]
    return TrialResult(
        plan,
        kind,
        assisted,
        line,
        duration,
        side_stiffness,
        course.initiated,
        course.reached,
        moving is not None,
        course.start_ns,
        course.end_ns,
        samples[0].sequence,
        samples[-1].sequence,
        len(samples),
        rate,
        gaps_of(samples),
        measures(during, line, duration, course.start_ns, course.initiated),
        _figures(kind, line, samples, times, rate, speed, moving, during),
    )


def _figures(kind, line, samples, times, rate, speed, moving, during) -> Figures:
    figures = Figures()
    if kind == HOLD:
        return figures._replace(
            hold_deviation=hold_deviation(_path(line, during), _point(line, line.start))
        )
    if kind == STRENGTH:
        return figures._replace(
            largest_force=_largest(line.along(s.force) for s in during),
            largest_vertical_force=_largest(abs(s.fz) for s in during),
        )
    if moving is None:
        return figures
    figures = _with_movement(figures, line, samples[moving], times[moving], rate, speed[moving])
    figures = figures._replace(time_to_start=float(times[moving.start]))
    path = _path(line, samples[moving])
    if kind == CIRCLE:
        return figures._replace(**circle_figures(path)._asdict())
    found = path_figures(path, _point(line, line.start), _point(line, line.target))
    reach_error = found.reach_error if kind == REACH else _NAN
    return figures._replace(
        path_error=found.error,
        path_ratio=found.ratio,
        direction_error=found.direction_error,
        reach_error=reach_error,
    )


def _largest(values: Iterable[float]) -> float:
    """Return the largest number, NaN without one; samples without a valid force are NaN."""
    return max((value for value in values if math.isfinite(value)), default=_NAN)


def _with_movement(figures, line, samples, times, rate, speed) -> Figures:
    found = speed_figures(speed, rate)
    axes = AXES[line.space]  # without other axes, which may be locked or not homed
    work = work_done(
        np.array([[s.force[a] for a in axes] for s in samples]),
        np.array([[s.velocity[a] for a in axes] for s in samples]),
        times,
    )
    return figures._replace(
        duration=found.duration,
        mean_speed=found.mean,
        peak_speed=found.peak,
        speed_ratio=found.ratio,
        speed_peaks=float(found.peaks),
        arrest_ratio=found.arrest,
        sparc=sparc(speed, rate),
        jerk=dimensionless_jerk(speed, rate),
        log_jerk=log_dimensionless_jerk(speed, rate),
        robot_share=work.robot_share,
        patient_work=work.patient,
        robot_work=work.robot,
    )


def _point(line: Line, point) -> tuple[float, float, float]:
    """Return a point with zeros on the axes outside the line's space [m]."""
    x, y, z = (value if axis in AXES[line.space] else 0.0 for axis, value in enumerate(point))
    return x, y, z


def _path(line: Line, samples: Sequence[HandSample]) -> np.ndarray:
    return np.array([_point(line, s.position) for s in samples])
