# SPDX-License-Identifier: Apache-2.0
"""A simulated patient who plays: sees what the screen shows and moves the rig's arm there.

In a session the arm goes to the start and to the target of each trial; while none runs, it goes
where a game wishes the hand to be (`therapy/wish`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from screw_module_msgs.msg import EndpointSetpoint, TherapyState

from ..operator.robot import Robot, arm

HEALTHY, TREMOR, WEAK = "healthy", "tremor", "weak"
_STILL = (0.0, 0.0, 0.0)
_CENTRE = (0.0, 0.0, 0.18)
_FAR_M = 0.03  # a wish that is so far from the last one is a new one


class Person(NamedTuple):
    """kind: of the rig's arm (SetArm.srv); duration: of a reach [s]; stiffness [N/m]."""

    kind: str
    duration: float
    stiffness: float = 500.0
    damping: float = 20.0
    mass: float = 3.0


PEOPLE = {
    HEALTHY: Person("active", 0.9),
    TREMOR: Person("tremor", 1.2),
    WEAK: Person("weak", 1.6),
}


class SimulatedPlayer:
    """Plays until the robot's client is closed; `look` is to be called over and over."""

    def __init__(self, robot: Robot, person: Person):
        self._robot, self._person = robot, person
        self._state: TherapyState | None = None
        self._wish: tuple[float, float, float] | None = None
        self._seen: object = None
        make = robot.node.create_subscription
        make(TherapyState, "therapy/state", self._hear_state, 10)
        make(EndpointSetpoint, "therapy/wish", self._hear_wish, 10)

    def take_hold(self) -> None:
        """Put the hand on the handle and keep it at the centre of the workspace."""
        person = self._person
        request = arm(
            _CENTRE, 0.5, _STILL, _STILL, person.kind, person.mass, person.stiffness, person.damping
        )
        self._robot.set_arm(request)

    def look(self) -> None:
        """Look at the screen once, and move."""
        goal = self._goal()
        if goal is None:
            return
        seen, point = goal
        if seen != self._seen and all(map(math.isfinite, point)):
            self._seen = seen
            self._robot.send_arm(arm(point, self._person.duration, _STILL, _STILL))

    def _goal(self) -> tuple[object, tuple[float, float, float]] | None:
        """Return what is to be done, and where."""
        state = self._state
        if state is not None and state.state == TherapyState.RUNNING:
            self._wish = None
            prepares = state.phase in (TherapyState.NONE, TherapyState.PREPARE)
            point = state.start if prepares else state.target
            return (state.trial, prepares), (point.x, point.y, point.z)
        if self._wish is not None:
            return self._wish, self._wish
        return None

    def _hear_state(self, message: TherapyState) -> None:
        self._state = message

    def _hear_wish(self, message: EndpointSetpoint) -> None:
        point = (message.position.x, message.position.y, message.position.z)
        if self._wish is None or math.dist(point, self._wish) > _FAR_M:
            self._wish = point
