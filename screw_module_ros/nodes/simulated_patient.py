# SPDX-License-Identifier: Apache-2.0
"""The eyes of the simulated patient: where he moves his hand by what the robot is asked for.

In a therapy session he sees the start and the target of each trial, or the circle; while his arm
is weighed he lets it hang. Without one, or where it is a game, he sees the point that a game wishes
(`therapy/wish`), or the set point of whoever publishes it, as far as a game may pull. How much of
it he does, and how fast, are traits of his arm. None of it reaches the devices of the rig: only his
hand does.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from screw_module_msgs.msg import EndpointSetpoint, TherapyState

from screw_module_ros import graph
from screw_module_ros.control.limits import clamp
from screw_module_ros.plant.patient import (
    CIRCLE_STEP_SHARE,
    ArmSettings,
    HumanArm,
    Triple,
    on_circle,
)
from screw_module_ros.therapy.hand import point_of
from screw_module_ros.therapy.protocol import CIRCLE, GAME, WEIGH
from screw_module_ros.therapy.wishes import SILENT_NS, WishLimits

from .support.node import Node
from .support.topics import requested

_FAR_M = 0.03  # a point that moves: the hand sets out anew when it is this far from its target
_NEAR_M = 0.001  # the same for a point that has come to rest


class SimulatedPatient:
    """Sends the virtual hand of the rig's arm on its way; all in the thread of the services.

    arm: returns the present arm. send: takes its next movement.
    """

    def __init__(
        self, node: Node, arm: Callable[[], HumanArm], send: Callable[[ArmSettings], None]
    ):
        self._clock, self._arm, self._send = node.clock, arm, send
        self._trial: object = None  # what of a session the hand does
        self._goal: Triple | None = None  # where it goes for a game
        self._point: Triple | None = None  # that was asked for last
        self._held: tuple[float, ...] = ()  # tension and carried, kept while the arm hangs
        self._trial_ns = self._wish_ns = -SILENT_NS
        self._node, self._subscriptions = node, []
        for topic, heard in (
            (graph.THERAPY_STATE, self.hear_state),
            (graph.THERAPY_WISH, self.hear_wish),
            (graph.SETPOINT, self.hear_setpoint),
        ):
            kind, name, profile = requested(topic)
            self._subscriptions.append(node.create_subscription(kind, name, heard, profile))

    def close(self) -> None:
        """See nothing any more."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)

    def hear_state(self, state: TherapyState) -> None:
        """See what a session asks for."""
        arm = self._arm()
        hangs = state.kind == WEIGH and state.phase == TherapyState.MOVING
        if hangs is not bool(self._held):  # the arm is weighed, or is taken up again
            values = self._held or (0.0, 0.0)
            self._held = (arm.tension, arm.carried) if hangs else ()
            self._send(ArmSettings(traits=("tension", "carried"), values=values))
        is_asked = state.state == TherapyState.RUNNING and state.kind != GAME
        if not is_asked or arm.follows == 0.0:
            return
        self._trial_ns, self._goal = self._clock.now_ns(), None
        trial, point = _asked(state, arm)
        if trial != self._trial and any(map(math.isfinite, point)):
            self._trial = trial
            self._send(ArmSettings(target=point, duration=arm.reach_time))

    def hear_wish(self, message: EndpointSetpoint) -> None:
        """See what a game asks for."""
        self._wish_ns = self._clock.now_ns()
        self._play(message)

    def hear_setpoint(self, message: EndpointSetpoint) -> None:
        """See a set point; one that `therapy_session` makes of a game's wish lags behind it."""
        if self._clock.now_ns() - self._wish_ns >= SILENT_NS:
            self._play(message)

    def _play(self, message: EndpointSetpoint) -> None:
        arm, position = self._arm(), message.position
        is_in_session = self._clock.now_ns() - self._trial_ns < SILENT_NS
        ranges = WishLimits().ranges()
        x, y, z = map(clamp, (position.x, position.y, position.z), *zip(*ranges, strict=True))
        point, before = (x, y, z), self._point
        if is_in_session or arm.follows == 0.0 or not any(map(math.isfinite, point)):
            return
        self._trial, self._point = None, point
        far = _NEAR_M if before is not None and _apart(point, before) == 0.0 else _FAR_M
        if self._goal is None or _apart(point, self._goal) > far:
            self._goal = point
            self._send(ArmSettings(target=point, duration=arm.reach_time))


def _apart(one: Triple, other: Triple) -> float:
    """Return the distance of two points [m]; an axis that neither names is no difference."""
    named = ([axis if math.isfinite(axis) else 0.0 for axis in point] for point in (one, other))
    return math.dist(*named)


def _asked(state: TherapyState, arm: HumanArm) -> tuple[object, Triple]:
    """Return the identity of a session's present movement, and where the hand goes for it [m].

    A circle starts at `target`, with `start` as its centre.
    """
    prepares = state.phase in (TherapyState.NONE, TherapyState.PREPARE)
    if state.kind == CIRCLE:
        passed = state.since if state.since > 0.0 else 0.0
        step = 0 if prepares else 1 + int(passed / (CIRCLE_STEP_SHARE * arm.reach_time))
        point = on_circle(point_of(state.start), point_of(state.target), step)
        return (state.trial, prepares, step), point
    share = 0.0 if prepares else arm.follows
    begin, end = state.start, state.target
    x, y, z = (
        a + share * (b - a) for a, b in ((begin.x, end.x), (begin.y, end.y), (begin.z, end.z))
    )
    return (state.trial, prepares), (x, y, z)
