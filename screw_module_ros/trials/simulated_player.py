# SPDX-License-Identifier: Apache-2.0
"""A simulated patient: follows the targets on the screen with the rig's arm.

In a session the arm moves to the start and to the target of each trial, or along its circle.
Without a session it follows the game's requested point (`therapy/wish`), as far as the robot goes,
until the game is silent.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from screw_module_msgs.msg import EndpointSetpoint, TherapyState

from ..control.limits import clamp
from ..operator.robot import Robot, arm
from ..therapy.protocol import CIRCLE
from ..therapy.wishes import SILENT_NS, WishLimits

HEALTHY, TREMOR, WEAK = "healthy", "tremor", "weak"
_STILL = (0.0, 0.0, 0.0)
_CENTRE = (0.0, 0.0, 0.18)
_FAR_M = 0.03  # the arm moves when the requested point has moved by this much
_STEPS, _STEP_SHARE = 12, 0.5  # of a turn; of a reach's time for each


class Person(NamedTuple):
    """kind: of the rig's arm (SetArm.srv); duration: of a reach [s]; stiffness [N/m].

    reach: share of the way to a session's target that the hand moves by itself.
    """

    kind: str
    duration: float
    stiffness: float = 500.0
    damping: float = 20.0
    mass: float = 3.0
    reach: float = 1.0


# A hand of 3 kg moves some 9 kg with the arm. 500 N/m and 20 Ns/m, damped by 0.15, pass a target
# 0.14 m away by 30 mm in 0.9 s; a practised hand, damped by 0.5, by a few millimetres in 1.1 s.
# A weak arm of 500 N/m held the hand where it stopped: with 8 N against a wall that takes all of a
# trial's time to become that stiff, and the assistance brought it to no target.
PEOPLE = {
    HEALTHY: Person("active", 1.1, stiffness=800.0, damping=80.0),
    TREMOR: Person("tremor", 1.2),
    WEAK: Person("weak", 2.6, stiffness=200.0, reach=0.8),
}


def _on_circle(state: TherapyState, step: int) -> tuple[float, float, float]:
    """Return the point on the circle [m] after `step` steps clockwise from its target."""
    angle = 2.0 * math.pi * step / _STEPS
    x, y = state.target.x - state.start.x, state.target.y - state.start.y
    turned_x = x * math.cos(angle) + y * math.sin(angle)
    turned_y = y * math.cos(angle) - x * math.sin(angle)
    return state.start.x + turned_x, state.start.y + turned_y, state.target.z


class SimulatedPlayer:
    """Moves the rig's arm; the caller calls `look` periodically."""

    def __init__(self, robot: Robot, person: Person):
        self._robot, self._person = robot, person
        self._state: TherapyState | None = None
        self._wish: tuple[float, ...] | None = None
        self._wished_ns = 0
        self._seen: object = None
        make = robot.node.create_subscription
        make(TherapyState, "therapy/state", self._hear_state, 10)
        make(EndpointSetpoint, "therapy/wish", self._hear_wish, 10)

    def take_hold(self) -> None:
        """Put the hand on the handle and hold it at the centre of the workspace."""
        person = self._person
        request = arm(
            _CENTRE, 0.5, _STILL, _STILL, person.kind, person.mass, person.stiffness, person.damping
        )
        self._robot.set_arm(request)

    def look(self) -> None:
        """Read the newest target; start a movement if it is a new one."""
        goal = self._goal()
        if goal is None:
            return
        seen, point = goal
        if seen != self._seen and all(map(math.isfinite, point)):
            self._seen = seen
            self._robot.send_arm(arm(point, self._person.duration, _STILL, _STILL))

    def _goal(self) -> tuple[object, tuple[float, ...]] | None:
        """Return the identity of the current target, and the target [m]."""
        state = self._state
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
            step = 0 if prepares else 1 + int((state.since if state.since > 0.0 else 0.0)
                                              / (_STEP_SHARE * self._person.duration))  # fmt: skip
            return (state.trial, prepares, step), _on_circle(state, step)
        share = 0.0 if prepares else self._person.reach
        begin, end = state.start, state.target
        ways = ((begin.x, end.x), (begin.y, end.y), (begin.z, end.z))
        return (state.trial, prepares), tuple(a + share * (b - a) for a, b in ways)

    def _hear_state(self, message: TherapyState) -> None:
        self._state = message

    def _hear_wish(self, message: EndpointSetpoint) -> None:
        wish = (message.position.x, message.position.y, message.position.z)
        point = tuple(
            clamp(asked, *reach) for asked, reach in zip(wish, WishLimits().ranges(), strict=True)
        )
        self._wished_ns = self._robot.clock.now_ns()
        if self._wish is None or math.dist(point, self._wish) > _FAR_M:
            self._wish = point
