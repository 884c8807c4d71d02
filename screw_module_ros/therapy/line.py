# SPDX-License-Identifier: Apache-2.0
"""The line of a movement from start to target, and the slots along it."""

from __future__ import annotations

from typing import NamedTuple

from ..control.slot import Slot, in_space
from .hand import AXES, PLANE, VERTICAL, Point, distance


class Line(NamedTuple):
    """start, target: x, y, z [m]; space: plane, vertical or space, which selects the axes."""

    start: Point
    target: Point
    space: str

    @property
    def length(self) -> float:
        """Return the way from start to target [m]."""
        return distance(self.space, self.target, self.start)

    def along(self, vector: Point) -> float:
        """Return a vector's component along the line, in its unit; zero without a direction."""
        if self.length == 0.0:
            return 0.0
        return sum(
            vector[a] * (self.target[a] - self.start[a]) / self.length for a in AXES[self.space]
        )

    def gone(self, point: Point) -> float:
        """Return a point's distance from the start along the line [m]."""
        x, y, z = (p - s for p, s in zip(point, self.start, strict=True))
        return self.along((x, y, z))

    def off(self, point: Point) -> float:
        """Return the square of a point's distance from the line [m^2]."""
        gone, length = self.gone(point), self.length or 1.0
        across = (
            point[a] - self.start[a] - gone * (self.target[a] - self.start[a]) / length
            for a in AXES[self.space]
        )
        return sum(each * each for each in across)


class Hold(NamedTuple):
    """What holds the axes that a protocol does not use: z if vertical, else x and y.

    It stays the same through all trials. point: around which [m]; stiffness [N/m].
    """

    point: Point
    vertical: bool
    stiffness: float


class SlotWish(NamedTuple):
    """Requested slots of the plane and of the vertical axis, None = no slot.

    start_ns: stamp of the movement's start [ns], None while the slots are open. hold: of other
    axes than those of the slots.
    """

    plane: Slot | None = None
    vertical: Slot | None = None
    start_ns: int | None = None
    hold: Hold | None = None


NO_SLOT = SlotWish()


def slots(line: Line, like: Slot, start_ns: int | None) -> SlotWish:
    """Return the slots along a line; like: their other parameters; start_ns: as in SlotWish."""
    plane, vertical = in_space(line.start, line.target, like)
    return SlotWish(
        plane if line.space != VERTICAL else None,
        vertical if line.space != PLANE else None,
        start_ns,
    )
