# SPDX-License-Identifier: Apache-2.0
"""The line of a movement from start to target, on the axes of the movement."""

from __future__ import annotations

import math
from typing import NamedTuple

from ..control.slot import Slot, in_space
from .samples import HandSample, Point

PLANE, VERTICAL, SPACE = "plane", "vertical", "space"
AXES = {PLANE: (0, 1), VERTICAL: (2,), SPACE: (0, 1, 2)}
"""Axes of a movement, by the protocol's space."""

FARTHEST = 1.0  # [m] on any axis; larger positions are impossible on this robot
FASTEST = 10.0  # [m/s] on any axis; larger velocities are impossible


class Line(NamedTuple):
    """start, target: x, y, z [m]; space: plane, vertical or space, which selects the axes."""

    start: Point
    target: Point
    space: str

    @property
    def length(self) -> float:
        """Return the way from start to target [m]."""
        return math.sqrt(sum((self.target[a] - self.start[a]) ** 2 for a in AXES[self.space]))

    def along(self, vector: Point) -> float:
        """Return a vector's component along the line, in its unit; zero without a direction."""
        if self.length == 0.0:
            return 0.0
        return sum(
            vector[a] * (self.target[a] - self.start[a]) / self.length for a in AXES[self.space]
        )

    def gone(self, point: Point) -> float:
        """Return a point's distance from the start along the line [m]."""
        return self.along(tuple(p - s for p, s in zip(point, self.start, strict=True)))

    def off(self, point: Point) -> float:
        """Return the square of a point's distance from the line [m^2]."""
        gone, length = self.gone(point), self.length or 1.0
        across = (
            point[a] - self.start[a] - gone * (self.target[a] - self.start[a]) / length
            for a in AXES[self.space]
        )
        return sum(each * each for each in across)


class SlotWish(NamedTuple):
    """Requested slots of the plane and of the vertical axis, None = no slot.

    start_ns: stamp of the movement's start [ns], None while the slots are open.
    """

    plane: Slot | None = None
    vertical: Slot | None = None
    start_ns: int | None = None


NO_SLOT = SlotWish()


def distance(space: str, one: Point, other: Point) -> float:
    """Return the distance of two points [m] on the axes of a space."""
    return math.sqrt(sum((one[a] - other[a]) ** 2 for a in AXES[space]))


def speed_of(space: str, sample: HandSample) -> float:
    """Return the hand's speed [m/s] on the axes of a space."""
    velocity = sample.velocity
    return math.sqrt(sum(velocity[a] ** 2 for a in AXES[space]))


def is_known(space: str, sample: HandSample) -> bool:
    """Return whether position and velocity are plausible on the axes of a space; NaN is not."""
    position, velocity = sample.position, sample.velocity
    return all(
        abs(position[a]) <= FARTHEST and abs(velocity[a]) <= FASTEST for a in AXES[space]
    )


def slots(line: Line, like: Slot, start_ns: int | None) -> SlotWish:
    """Return the slots along a line; like: their other parameters; start_ns: as in SlotWish."""
    plane, vertical = in_space(line.start, line.target, like)
    return SlotWish(
        plane if line.space != VERTICAL else None,
        vertical if line.space != PLANE else None,
        start_ns,
    )
