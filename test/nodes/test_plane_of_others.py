# SPDX-License-Identifier: Apache-2.0
"""Law and arm of other packages in the plane, in the graph: nodes, parameters, messages."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from screw_module_msgs.msg import PlanarState, SafetyState

from screw_module_ros.operator.robot import Robot
from screw_module_ros.recording.decoded import read_bag
from screw_module_ros.trials.runner import GraphRun

pytestmark = [pytest.mark.graph, pytest.mark.long]

CHAIN = ["sim_rig", "supervisor", "encoder", "force_sensor", "manus", "session_recorder"]
HERE = Path(__file__)
PLACES = (HERE.parents[1] / "loop", HERE.parents[2] / "examples" / "own_arm")
GIVEN = (
    "manus:law:=plane_laws_of_others:THE_ASKED",
    "manus:arm:=serial_arm:SERIAL",
    "sim_rig:plane_plant:=serial_plant:SERIAL_PLANT",
    'supervisor:required:=["force_sensor", "manus"]',
)


def test_a_law_and_an_arm_of_others_move_the_hand_and_a_failure_is_told(monkeypatch, tmp_path):
    """By parameters alone: no file of the package knows either. A recording says what ran."""
    for place in PLACES:
        monkeypatch.setenv("PYTHONPATH", str(place), prepend=os.pathsep)
    givens = (*GIVEN, f"session_recorder:folder:={tmp_path}")
    extra = [word for given in givens for word in ("-p", given)]
    with GraphRun(only=CHAIN, extra=extra) as graph:
        with Robot("tester", watch=graph.watch) as robot:
            graph.wait_until_ready(robot)
            robot.wait_until(lambda: robot.state(PlanarState), 20.0, "no state of the plane")
            state = robot.newest(PlanarState)
            assert state.law.startswith("asked ") and state.arm.startswith("serial ")
            assert list(state.law_names) == ["ticks"] and "unknown" not in state.law + state.arm
            robot.trigger("manus/home")
            robot.tare()
            robot.permit()
            robot.enable_plane()
            bag = robot.start_recording()
            robot.set_parameter("manus", "asked.pull_x", 20.0)
            robot.wait_until(
                lambda: robot.newest(PlanarState).position[0] > 0.01, 20.0, "nothing moves"
            )
            assert robot.newest(PlanarState).law_values[0] > 100.0
            robot.stop_recording()
            recorded = [each.message for each in read_bag(bag, ["/manus/state"])]
            assert {(each.law, each.arm) for each in recorded} == {(state.law, state.arm)}
            assert recorded[-1].law_values[0] > recorded[0].law_values[0]
            robot.set_parameter("manus", "asked.raises", True)
            robot.wait_until(
                lambda: robot.newest(PlanarState).reason
                == "law asked: KeyError: 'no such muscle'",
                20.0, "nobody says that the law has failed",
            )  # fmt: skip
            assert list(robot.newest(PlanarState).commanded_torque) == [0.0, 0.0]
            robot.wait_until(
                lambda: (seen := robot.newest(SafetyState)) and not seen.planar_permitted, 20.0,
                "the supervisor has not seen it",
            )  # fmt: skip
