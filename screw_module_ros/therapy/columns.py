# SPDX-License-Identifier: Apache-2.0
"""The samples of one trial as columns, from which the measures are computed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..control.minimum_jerk import way
from .hand import AXES, HandSample, Point, speed_of
from .kinematics import moving, ratio, work_done
from .line import Line
from .smoothness import low_passed_speed


@dataclass
class Trial:
    """One trial in columns, each computed once.

    kind: of the trial; line: from start to target; wall_time: duration of the back wall's way [s];
    start_ns, end_ns: times of start and end of the movement [ns]; samples: from the display of the
    target to the trial's end, at least one.
    """

    kind: str
    line: Line
    wall_time: float
    start_ns: int
    end_ns: int
    samples: Sequence[HandSample]

    @cached_property
    def times(self) -> np.ndarray:
        """Time since the display of the target [s]."""
        return np.array([s.time_ns - self.samples[0].time_ns for s in self.samples]) * 1e-9

    @cached_property
    def rate(self) -> float:
        """Sampling rate [Hz], NaN without two samples."""
        return ratio(len(self.samples) - 1, float(self.times[-1]))

    @cached_property
    def cut(self) -> slice | None:
        """Samples of the movement, None without one."""
        return moving(self.all_speed, self.rate) if self.rate > 0.0 else None

    @property
    def movement(self) -> slice:
        """Samples of the movement. Raises ValueError without one."""
        if self.cut is None:
            raise ValueError("the hand did not move in this trial")
        return self.cut

    @cached_property
    def all_speed(self) -> np.ndarray:
        """Speed of all samples on the axes of the line's space [m/s]."""
        return np.array([speed_of(self.line.space, s) for s in self.samples])

    @cached_property
    def speed(self) -> np.ndarray:
        """Speed of the movement [m/s]."""
        return self.all_speed[self.movement]

    @cached_property
    def smooth_speed(self) -> np.ndarray:
        """Speed of the movement behind a low pass [m/s], for what is a derivative of it."""
        path = np.array([self.on_axes(s.position) for s in self.samples])
        begin, last = (
            round(float(self.times[place]) * self.rate)
            for place in (self.movement.start, self.movement.stop - 1)
        )
        return low_passed_speed(self.times, path)[begin : last + 1]

    @cached_property
    def path(self) -> np.ndarray:
        """Positions of the movement [m], shape (samples, 3)."""
        return np.array([self.on_axes(s.position) for s in self.samples[self.movement]])

    @cached_property
    def ends(self) -> tuple[Point, Point]:
        """Start and target [m]."""
        return self.on_axes(self.line.start), self.on_axes(self.line.target)

    def on_axes(self, point: Point) -> Point:
        """Return a point with zeros on other axes, which may be locked or not homed [m]."""
        x, y, z = (v if axis in AXES[self.line.space] else 0.0 for axis, v in enumerate(point))
        return x, y, z

    @cached_property
    def work(self) -> tuple[float, float]:
        """Work of the patient and of the robot [J]."""
        samples, axes = self.samples[self.movement], AXES[self.line.space]
        force = np.array([[s.force[a] for a in axes] for s in samples])
        velocity = np.array([[s.velocity[a] for a in axes] for s in samples])
        return work_done(force, velocity, self.times[self.movement])

    @cached_property
    def during(self) -> list[HandSample]:
        """Samples from start to end of the movement."""
        return [s for s in self.samples if self.start_ns <= s.time_ns <= self.end_ns]

    @cached_property
    def leads(self) -> list[float]:
        """Way of the hand minus that of the back wall, `during` the movement [m].

        After its arrival the wall stays at the target, so that a late hand lags.
        """
        length = self.line.length
        return [
            self.line.gone(s.position)
            - length * way((s.time_ns - self.start_ns) * 1e-9 / self.wall_time)
            for s in self.during
        ]

    def power(self, sample: HandSample) -> float:
        """Return handle force times velocity along the line [W], zero without a valid force."""
        power = self.line.along(sample.force) * self.line.along(sample.velocity)
        return power if math.isfinite(power) else 0.0
