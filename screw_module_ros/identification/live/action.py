# SPDX-License-Identifier: Apache-2.0
"""An action server that executes one goal at a time, in a thread.

rclpy runs a goal as a task of the executor: a plain callback would delay cancel requests, and a
coroutine that awaits the thread's future is polled in every spin (in Jazzy `Future.__await__`
yields until it is done), which keeps a core busy beside the hot loop. Here the task is created only
after the work.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, NamedTuple

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.clock import Clock, ClockType
from rclpy.node import Node


class Outcome(NamedTuple):
    """How a goal ended: the action's result, and whether it succeeded or was cancelled."""

    result: Any
    succeeded: bool
    cancelled: bool = False


class OneGoalServer(ActionServer):
    """Executes one goal at a time.

    work: called in a thread with the goal handle; refusal: returns why no goal can be accepted,
    empty if one can; cancelling: called as soon as a client cancels the goal.
    """

    def __init__(
        self,
        node: Node,
        kind: type,
        name: str,
        work: Callable[[ServerGoalHandle], Outcome],
        refusal: Callable[[], str],
        cancelling: Callable[[], None],
    ):
        self._work, self._refusal, self._cancelling = work, refusal, cancelling
        self._thread: threading.Thread | None = None
        super().__init__(
            _BySystemTime(node),
            kind,
            name,
            _never,
            goal_callback=self._decide,
            cancel_callback=self._cancel,
        )

    @property
    def busy(self) -> bool:
        """Whether a goal is being executed."""
        return self._thread is not None and self._thread.is_alive()

    def _decide(self, request: Any) -> GoalResponse:
        refused = "a goal is being worked on: cancel it first" if self.busy else self._refusal()
        if refused:
            self._logger.error(f"goal refused: {refused}")
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _cancel(self, goal: ServerGoalHandle) -> CancelResponse:
        self._cancelling()
        return CancelResponse.ACCEPT

    def notify_execute(self, goal_handle: ServerGoalHandle, execute_callback: Any) -> None:
        """Start the thread of an accepted goal; called by rclpy."""
        self._thread = threading.Thread(
            target=self._work_on, args=(goal_handle,), name="goal", daemon=True
        )
        self._thread.start()

    def _work_on(self, goal: ServerGoalHandle) -> None:
        outcome = self._work(goal)

        def finish(goal: ServerGoalHandle) -> Any:
            if outcome.cancelled and goal.is_cancel_requested:
                goal.canceled()
            elif outcome.succeeded:
                goal.succeed()
            else:
                goal.abort()
            return outcome.result

        super().notify_execute(goal, finish)


class _BySystemTime:
    """A node with the system clock, for the expiry of results: ROS time may stand still."""

    def __init__(self, node: Node):
        self._node, self._clock = node, Clock(clock_type=ClockType.SYSTEM_TIME)

    def get_clock(self) -> Clock:
        return self._clock

    def __getattr__(self, name: str) -> Any:
        return getattr(self._node, name)


def _never(goal: ServerGoalHandle) -> None:
    raise AssertionError("a goal is worked on by its thread")
