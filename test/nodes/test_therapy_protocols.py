# SPDX-License-Identifier: Apache-2.0
"""Every kind of trial on the whole graph: the elevator, and all parts of the evaluation."""

from __future__ import annotations

import math

import pytest
import yaml
from screw_module_msgs.msg import TherapyState, TrialResult
from screw_module_msgs.srv import StartTherapy

from screw_module_ros.nodes import bringup
from screw_module_ros.operator.robot import Robot
from screw_module_ros.resources import resource_path
from screw_module_ros.trials.graph_run import GraphRun
from screw_module_ros.trials.simulated_player import HEALTHY, PEOPLE, SimulatedPlayer
from screw_module_ros.trials.therapy import make_ready

pytestmark = [pytest.mark.graph, pytest.mark.timeout(400)]

KINDS = ["reach", "reach", "circle", "hold", "resisted", "strength"]


def write_short(folder, name):
    """Write a protocol with each of its different blocks once, of one target, in little time."""
    content = yaml.safe_load(resource_path(f"params/therapy/{name}.yaml").read_text())
    blocks = content["blocks"][1:2] if name == "elevator" else content["blocks"]
    for block in blocks:
        block["circuits"] = 1
        block["targets"] = {**block["targets"], "count": 1, "rounds": 1}
        if "duration" in block:
            block["duration"] = 4.0 if block["kind"] == "circle" else 1.0
    content["blocks"] = blocks
    content["rules"].update(
        hit_radius=0.02, wait=0.5, give_up=4.0, hold=0.1, settle_time=0.05, prepare_duration=1.2
    )
    (folder / f"{name}_short.yaml").write_text(yaml.safe_dump(content))
    return f"{name}_short.yaml"


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Results of both protocols, by name."""
    folder = tmp_path_factory.mktemp("therapy")
    with (
        GraphRun(extra=["-p", "sim_rig:speed:=0.0"], without=["session_recorder"],
                 composed=True) as graph,
        Robot("therapist", watch=graph.watch, simulated=True) as robot,
    ):  # fmt: skip
        node = bringup.Process(
            "therapy_session",
            ["--ros-args", *graph.arguments("endpoint_state"), "-p", f"folder:={folder}"],
        )
        try:
            robot.wait_until_ready([*graph.names, "therapy_session"])
            player = SimulatedPlayer(robot, PEOPLE[HEALTHY])
            make_ready(robot, player)
            states, told = [], []
            make = robot.node.create_subscription
            make(TherapyState, "therapy/state", states.append, 50)
            make(TrialResult, "therapy/trial", told.append, 50)
            for name in ("elevator", "evaluation"):
                play(robot, player, states, write_short(folder, name))
            yield {name: [result for result in told if result.protocol == name]
                   for name in ("elevator", "evaluation")}  # fmt: skip
        finally:
            code = node.stop()
    assert code == 0


def play(robot, player, states, protocol):
    """Carry out a protocol, and be its patient until it is finished."""
    request = StartTherapy.Request(protocol=protocol, patient="P-7K3QX", record=False)
    robot.wait_until(lambda: states, 20.0, "the session is silent")
    robot.ask(StartTherapy, "therapy_session/start", request)
    states.clear()

    def finished():
        player.look()
        state = states[-1] if states else None
        assert state is None or state.state in (TherapyState.RUNNING, TherapyState.FINISHED), (
            state.reason
        )
        return state is not None and state.state == TherapyState.FINISHED

    robot.wait_until(finished, 120.0, f"{protocol} does not come to its end")


def test_the_elevator_goes_up_and_down_and_back(results):
    found = results["elevator"]
    heights = [round(result.target.z, 2) for result in found]
    assert heights == [0.32, 0.18, 0.04, 0.18]
    assert all(result.assisted for result in found)
    assert sum(result.reached for result in found) >= 3
    assert all(math.isfinite(result.sparc) for result in found if result.moved)
    assert {result.missing for result in found} == {0}


def test_every_part_of_the_evaluation_has_its_figures(results):
    found = results["evaluation"]
    assert [result.kind for result in found] == KINDS
    by_kind = {result.kind: result for result in found}
    assert by_kind["reach"].moved and math.isfinite(by_kind["reach"].log_jerk)
    assert by_kind["circle"].moved and by_kind["circle"].size > 0.0
    assert 0.0 < by_kind["hold"].hold_deviation < 0.03
    assert 0.01 < by_kind["resisted"].pm4 < 0.16, "[m]; held back by a spring"
    assert by_kind["strength"].largest_force > 2.0, "[N]; it pushes against what holds it"
    assert not any(result.assisted for result in found)
