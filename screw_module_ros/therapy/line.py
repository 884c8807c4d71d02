# SPDX-License-Identifier: Apache-2.0
"""The line of a movement from start to target, on the axes that the movement has."""

from __future__ import annotations

import math
from typing import NamedTuple

from ..control.slot import Slot, in_space
from .samples import HandSample, Point

PLANE, VERTICAL, SPACE = "plane", "vertical", "space"
AXES = {PLANE: (0, 1), VERTICAL: (2,), SPACE: (0, 1, 2)}
"""Components of a point that count, by where a protocol takes place."""

FARTHEST = 1.0  # [m] on any axis: beyond it no hand on this robot can be
FASTEST = 10.0  # [m/s] the same


class Line(NamedTuple):
    """start, target: x, y, z [m]; space: plane, vertical or space; the other axes do not count."""

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
        """Return how far along the line a point is from the start [m]."""
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
    """What the controllers are to do: a slot in the plane, one on the vertical, None = none.

    start_ns: stamp of the movement's start [ns], None while the slots are open.
    """

    plane: Slot | None = None
    vertical: Slot | None = None
    start_ns: int | None = None


NO_SLOT = SlotWish()


def distance(space: str, one: Point, other: Point) -> float:
    """Return the distance of two points [m] on the axes that count."""
    return math.sqrt(sum((one[a] - other[a]) ** 2 for a in AXES[space]))


def speed_of(space: str, sample: HandSample) -> float:
    """Return the hand's speed [m/s] on the axes that count."""
    velocity = sample.velocity
    return math.sqrt(sum(velocity[a] ** 2 for a in AXES[space]))


def is_known(space: str, sample: HandSample) -> bool:
    """Return whether position and velocity can be real on the axes that count; NaN cannot."""
    position, velocity = sample.position, sample.velocity
    return all(
        abs(position[a]) <= FARTHEST and abs(velocity[a]) <= FASTEST for a in AXES[space]
    )


def slots(line: Line, like: Slot, start_ns: int | None) -> SlotWish:
    """Return the slots along a line; like: everything but start and target."""
    plane, vertical = in_space(line.start, line.target, like)
    return SlotWish(
        plane if line.space != VERTICAL else None,
        vertical if line.space != PLANE else None,
        start_ns,
    )
