# SPDX-License-Identifier: Apache-2.0
"""The simulated patient of the rig: the hand on the handle, people, the centre-out reach.

In a therapy session the arm moves to the start and to the target of each trial, or along its
circle. Without a session it follows the game's requested point (`therapy/wish`), as far as the
robot goes, until the game is silent.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

from screw_module_msgs.msg import EndpointSetpoint, TherapyState
from screw_module_msgs.srv import SetArm

from ..control.limits import clamp
from ..operator.robot import Robot, arm
from ..therapy.protocol import CIRCLE
from ..therapy.wishes import SILENT_NS, WishLimits

HEALTHY, TREMOR, WEAK, FLACCID = "healthy", "tremor", "weak", "flaccid"
STILL = (0.0, 0.0, 0.0)
RADIUS = 0.10
"""Of the centre-out reach, from the workspace centre to each target [m]."""
TARGETS = 8
_CENTRE = (0.0, 0.0, 0.18)
_FAR_M = 0.03  # the arm moves when the requested point has moved by this much
_STEPS, _STEP_SHARE = 12, 0.5  # of a turn; of a reach's time for each
_REST = 0.1  # share of each way's time spent standing at its end


class Hand:
    """The hand on the rig's handle; the `Hand` of `bring_up`.

    The robot starts with nut and arm at their reference marks: they stay there while nobody holds
    the handle. takes: of the arm that takes hold of it.
    """

    at_rest = True

    def __init__(self, robot: Robot, takes: SetArm.Request):
        self._robot, self._takes = robot, takes
        self._holds: bool | None = None

    def let_go(self) -> None:
        """Leave the handle alone."""
        if self._holds is not False:
            self._robot.set_fixture("free")
            self._holds = False

    to_mark = plane_to_mark = let_go

    def take_hold(self) -> None:
        """Put the hand on the handle."""
        if not self._holds:
            self._robot.set_fixture("human_arm")
            self._robot.set_arm(self._takes)
            self._holds = True


# Centre-out reach of MANUS therapy ----------------------------------------------------------------


class Way(NamedTuple):
    """One straight way of the reach.

    begin [s] and duration [s]; start and end: x, y from the workspace centre [m].
    """

    begin: float
    duration: float
    start: tuple[float, float]
    end: tuple[float, float]

    def at(self, time: float) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return position [m] and velocity [m/s]: minimum jerk (flashhogan1985)."""
        share = clamp((time - self.begin) / self.duration, 0.0, 1.0)
        gone = share**3 * (10.0 - 15.0 * share + 6.0 * share * share)
        pace = 30.0 * (share * (1.0 - share)) ** 2 / self.duration
        (x, y), (dx, dy) = self.start, (self.end[0] - self.start[0], self.end[1] - self.start[1])
        return (x + gone * dx, y + gone * dy), (pace * dx, pace * dy)


def targets() -> list[tuple[float, float]]:
    """Return the targets x, y [m], evenly on the circle, beginning away from the patient."""
    angles = [math.pi / 2 - 2 * math.pi * number / TARGETS for number in range(TARGETS)]
    return [(RADIUS * math.cos(angle), RADIUS * math.sin(angle)) for angle in angles]


def centre_out(duration: float, points: list[tuple[float, float]]) -> list[Way]:
    """Return the ways to each point and back within `duration` [s], one after the other."""
    each = duration / (2 * len(points))
    stops = [stop for point in points for stop in ((0.0, 0.0), point)] + [(0.0, 0.0)]
    return [
        Way(number * each, each * (1.0 - _REST), start, end)
        for number, (start, end) in enumerate(zip(stops, stops[1:], strict=False))
    ]


# People in a therapy session ----------------------------------------------------------------------


class Person(NamedTuple):
    """kind: of the rig's arm (SetArm.srv); duration: of a reach [s]; stiffness [N/m].

    reach: share of the way to a session's target that the hand moves by itself, 0 = it never moves
    by itself; traits: of the arm, by name (`plant.patient.TRAITS`).
    """

    kind: str
    duration: float
    stiffness: float = 500.0
    damping: float = 20.0
    mass: float = 3.0
    reach: float = 1.0
    traits: tuple[tuple[str, float], ...] = ()

    def with_traits(self, traits: Iterable[tuple[str, float]]) -> Person:
        """Return this person with other values of some traits; of two, the last counts."""
        return self._replace(traits=tuple({**dict(self.traits), **dict(traits)}.items()))

    def takes_hold(self) -> SetArm.Request:
        """Return the arm of this person, at the centre of the workspace."""
        return arm(
            _CENTRE, 0.5, STILL, STILL, self.kind, self.mass, self.stiffness, self.damping,
            dict(self.traits),
        )


# A hand of 3 kg moves some 9 kg with the arm. 500 N/m and 20 Ns/m, damped by 0.15, pass a target
# 0.14 m away by 30 mm in 0.9 s; a practised hand, damped by 0.5, by a few millimetres in 1.1 s.
# A weak arm of 500 N/m held the hand where it stopped: with 8 N against a wall that takes all of a
# trial's time to become that stiff, and the assistance brought it to no target.
PEOPLE = {
    HEALTHY: Person("active", 1.1, stiffness=800.0, damping=80.0),
    TREMOR: Person("tremor", 1.2),
    WEAK: Person("weak", 2.6, stiffness=200.0, reach=0.8),
    # All of the arm hangs on the handle, as heavy as thesis 2.1.1 found one. 30 N/m act (ours).
    FLACCID: Person(
        "relaxed", 1.1, stiffness=300.0, damping=10.0, reach=0.0,
        traits=(("weight", 20.0), ("carried", 0.0)),
    ),
}


class SimulatedPlayer:
    """Moves the rig's arm as the screen asks; the caller calls `look` periodically.

    state: of the session, None before the first.
    """

    def __init__(self, robot: Robot, person: Person):
        self._robot, self._person = robot, person
        self.state: TherapyState | None = None
        self._wish: tuple[float, float, float] | None = None
        self._wished_ns = 0
        self._seen: object = None
        make = robot.node.create_subscription
        make(TherapyState, "therapy/state", self._hear_state, 10)
        make(EndpointSetpoint, "therapy/wish", self._hear_wish, 10)

    def look(self) -> None:
        """Read the newest target; start a movement if it is a new one."""
        goal = self._goal()
        if goal is None or self._person.reach == 0.0:
            return
        seen, point = goal
        if seen != self._seen and any(map(math.isfinite, point)):  # NaN: the axis goes on
            self._seen = seen
            self._robot.send_arm(arm(point, self._person.duration, STILL, STILL))

    def _goal(self) -> tuple[object, tuple[float, float, float]] | None:
        """Return the identity of the current target, and the target [m]."""
        state = self.state
        if state is not None and state.state == TherapyState.RUNNING:
            self._wish = None
            return self._asked(state)
        if self._robot.clock.now_ns() - self._wished_ns > SILENT_NS:
            self._wish = None
        return None if self._wish is None else (self._wish, self._wish)

    def _asked(self, state: TherapyState) -> tuple[object, tuple[float, float, float]]:
        """Return the session's target; a circle starts at `target`, with `start` as its centre."""
        prepares = state.phase in (TherapyState.NONE, TherapyState.PREPARE)
        if state.kind == CIRCLE:
            passed = state.since if state.since > 0.0 else 0.0
            step = 0 if prepares else 1 + int(passed / (_STEP_SHARE * self._person.duration))
            return (state.trial, prepares, step), _on_circle(state, step)
        share = 0.0 if prepares else self._person.reach
        begin, end = state.start, state.target
        ways = ((begin.x, end.x), (begin.y, end.y), (begin.z, end.z))
        x, y, z = (a + share * (b - a) for a, b in ways)
        return (state.trial, prepares), (x, y, z)

    def _hear_state(self, message: TherapyState) -> None:
        self.state = message

    def _hear_wish(self, message: EndpointSetpoint) -> None:
        wish = (message.position.x, message.position.y, message.position.z)
        x, y, z = (
            clamp(asked, *reach) for asked, reach in zip(wish, WishLimits().ranges(), strict=True)
        )
        self._wished_ns = self._robot.clock.now_ns()
        if self._wish is None or math.dist(_named((x, y, z)), _named(self._wish)) > _FAR_M:
            self._wish = x, y, z


def _named(wish: tuple[float, ...]) -> tuple[float, ...]:
    """Return a wish with 0 for the axes that it leaves alone."""
    return tuple(axis if math.isfinite(axis) else 0.0 for axis in wish)


def _on_circle(state: TherapyState, step: int) -> tuple[float, float, float]:
    """Return the point on the circle [m] after `step` steps clockwise from its target."""
    angle = 2.0 * math.pi * step / _STEPS
    x, y = state.target.x - state.start.x, state.target.y - state.start.y
    turned_x = x * math.cos(angle) + y * math.sin(angle)
    turned_y = y * math.cos(angle) - x * math.sin(angle)
    return state.start.x + turned_x, state.start.y + turned_y, state.target.z
