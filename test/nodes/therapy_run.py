# SPDX-License-Identifier: Apache-2.0
"""The whole graph in simulated time with a therapy_session, whose patient is the simulated one."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from screw_module_msgs.msg import AssistanceChange, TherapyState, TrialResult

from screw_module_ros.graph import WHOLE
from screw_module_ros.nodes import bringup
from screw_module_ros.operator.robot import Robot
from screw_module_ros.terminal import Console
from screw_module_ros.trials.runner import GraphRun
from screw_module_ros.trials.therapy import make_ready


class Patient:
    """Plays what the screen shows; states, results, changes: what was told so far.

    The rig's patient does so by himself; this one waits and listens.
    """

    def __init__(self, robot: Robot):
        self.states: list[TherapyState] = []
        self.results: list[TrialResult] = []
        self.changes: list[AssistanceChange] = []
        self._robot = robot
        make = robot.node.create_subscription
        make(TherapyState, "therapy/state", self.states.append, 50)
        make(TrialResult, "therapy/trial", self.results.append, 50)
        make(AssistanceChange, "therapy/assistance", self.changes.append, 50)

    def until(self, condition, seconds: float, what: str) -> None:
        """Play until the condition holds."""
        self._robot.wait_until(condition, seconds, what)

    def until_state(self, wanted: int, seconds: float = 90.0) -> None:
        """Play until the session has come to a state."""
        self.until(
            lambda: bool(self.states) and self.states[-1].state == wanted,
            seconds,
            f"the session does not come to state {wanted}",
        )


@contextmanager
def therapy_run(folder: Path, *extra: str) -> Iterator[tuple[Robot, Patient]]:
    """Yield operator and patient, ready for a session; folder: of protocols and bags."""
    extra = ("-p", f"session_recorder:folder:={folder}", *extra)
    with (
        GraphRun(extra=extra, shared=WHOLE) as graph,
        Robot("therapist", watch=graph.watch, simulated=True) as robot,
    ):
        node = bringup.Process(
            "therapy_session",
            ["--ros-args", *graph.arguments("endpoint_state"), "-p", f"folder:={folder}"],
        )
        try:
            robot.wait_until_ready([*graph.names, "therapy_session"])
            make_ready(robot, Console(quiet=True))
            patient = Patient(robot)
            robot.wait_until(lambda: patient.states, 20.0, "the session is silent")
            yield robot, patient
        finally:
            code = node.stop()
        assert code == 0
