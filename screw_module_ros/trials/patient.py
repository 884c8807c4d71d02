# SPDX-License-Identifier: Apache-2.0
"""The hand on the rig's handle, and the centre-out reach of therapy with MIT-MANUS."""

from __future__ import annotations

import math

from screw_module_msgs.srv import SetArm

from ..operator.bring_up import bring_up
from ..operator.robot import Robot
from ..plant.patient import HandPath
from ..terminal import Console

STILL = (0.0, 0.0, 0.0)
FORCE_GAIN = 5.0
RADIUS = 0.10
"""Of the centre-out reach, from the workspace centre to each target [m]."""
TARGETS = 8
_REST = 0.1  # share of each way's time spent standing at its end


class Hand:
    """The hand on the rig's handle; the `Hand` of `bring_up`.

    The robot starts with nut and arm at their reference marks: they stay there while nobody holds
    the handle. takes: changes of the arm that takes hold of it, in order. holds: whether it does,
    None before the first.
    """

    at_rest = True

    def __init__(self, robot: Robot, *takes: SetArm.Request):
        self._robot, self._takes = robot, takes
        self.holds: bool | None = None

    def let_go(self) -> None:
        """Leave the handle alone."""
        if self.holds is not False:
            self._robot.set_fixture("free")
            self.holds = False

    to_mark = plane_to_mark = let_go

    def take_hold(self) -> None:
        """Put the hand on the handle."""
        if not self.holds:
            self._robot.set_fixture("human_arm")
            for change in self._takes:
                self._robot.set_arm(change)
            self.holds = True

    def change(self) -> None:
        """Let the handle go, or take hold of it again."""
        (self.let_go if self.holds else self.take_hold)()


def ready(
    robot: Robot, console: Console, hand: Hand, mode: int, vertical: tuple[float, float],
    plane: tuple[float, float],
) -> Hand:  # fmt: skip
    """Bring the started robot to operation in a mode; return the hand on its handle.

    vertical, plane: stiffness [N/m] and damping [Ns/m] of both controllers.
    """
    with console.step("homing, taring, patient takes hold, torque on"):
        robot.set_parameter("impedance_controller", "force_gain", FORCE_GAIN)
        robot.set_impedance(*vertical)
        robot.set_impedance(*plane, node="manus")
        bring_up(robot, mode, hand)
    return hand


# Centre-out reach of MANUS therapy ----------------------------------------------------------------


def targets() -> list[tuple[float, float]]:
    """Return the targets x, y [m], evenly on the circle, beginning away from the patient."""
    angles = [math.pi / 2 - 2 * math.pi * number / TARGETS for number in range(TARGETS)]
    return [(RADIUS * math.cos(angle), RADIUS * math.sin(angle)) for angle in angles]


def centre_out(
    duration: float, points: list[tuple[float, float]]
) -> list[tuple[HandPath, HandPath]]:
    """Return the ways to each point and back within `duration` [s], one after the other.

    They are paths along x and y, as of the hand of the rig's patient.
    """
    each = duration / (2 * len(points))
    stops = [stop for point in points for stop in ((0.0, 0.0), point)] + [(0.0, 0.0)]
    ways = []
    for number, (start, end) in enumerate(zip(stops, stops[1:], strict=False)):
        x, y = (
            HandPath(*ends, number * each, each * (1.0 - _REST), 0.0, 0.0, 0.0)
            for ends in zip(start, end, strict=True)
        )
        ways.append((x, y))
    return ways
