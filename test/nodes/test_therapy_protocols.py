# SPDX-License-Identifier: Apache-2.0
"""Every kind of trial on the whole graph: elevator, reach in space, all parts of the evaluation.

Each is recorded, and its recording is computed again.
"""

from __future__ import annotations

import math
import re
import shutil

import pytest
import yaml
from mcap.reader import make_reader
from screw_module_msgs.msg import TherapyState
from screw_module_msgs.srv import StartTherapy
from therapy_run import therapy_run

from screw_module_ros.recording.bag import METADATA_FILE
from screw_module_ros.resources import resource_path
from screw_module_ros.session_command import main

pytestmark = [pytest.mark.graph, pytest.mark.long]

PATIENT, NAMES = "P-7K3QX", ("elevator", "reach_3d", "evaluation")
KINDS = ["reach", "reach", "circle", "hold", "resisted", "strength"]

GOOD = (TherapyState.STARTING, TherapyState.RUNNING, TherapyState.FINISHED)


def write_short(folder, name):
    """Write a protocol with each of its different blocks once, of one target, in little time."""
    content = yaml.safe_load(resource_path(f"params/therapy/{name}.yaml").read_text())
    blocks = content["blocks"] if name == "evaluation" else content["blocks"][1:2]
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
def folder(tmp_path_factory):
    """Protocols and bags."""
    return tmp_path_factory.mktemp("therapy")


@pytest.fixture(scope="module")
def results(folder):
    """Results of the protocols, by name."""
    with therapy_run(folder, "-p", "sim_rig:speed:=0.0") as (robot, patient):
        for name in NAMES:
            play(robot, patient, write_short(folder, name))
            await_bag(robot, patient.states, folder, name)
    return {name: [each for each in patient.results if each.protocol == name] for name in NAMES}


def start(robot, request):
    """Start a session, once its node has been found by those that it hears."""
    refused = []

    def started():
        answer = robot.call(StartTherapy, "therapy_session/start", request)
        refused.append(answer.message)
        return answer.success or "no endpoint_state has come yet" not in answer.message

    assert robot.met_by_wall(started, 60.0), refused[-1]
    assert not refused[-1], refused[-1]


def play(robot, patient, protocol):
    """Carry out a protocol, and be its patient until it is finished."""
    start(robot, StartTherapy.Request(protocol=protocol, patient=PATIENT, record=True))
    patient.states.clear()

    def finished():
        state = patient.states[-1] if patient.states else None
        assert state is None or state.state in GOOD, state.reason
        return state is not None and state.state == TherapyState.FINISHED

    patient.until(finished, 120.0, f"{protocol} does not come to its end")


def await_bag(robot, states, folder, name):
    """Wait until the recording of a protocol has ended."""
    robot.wait_until(lambda: not states[-1].recorded, 30.0, f"the recording of {name} goes on")
    robot.wait_until(
        lambda: (bag_of(folder, name) / METADATA_FILE).exists(), 30.0, "the bag is not closed"
    )


def bag_of(folder, name):
    (bag,) = folder.glob(f"{PATIENT}_{name}_*")
    return bag


@pytest.mark.parametrize("name", NAMES)
def test_each_is_computed_again_from_its_recording_bit_for_bit(results, folder, name, capsys):
    assert main(["replay", str(bag_of(folder, name))]) == 0
    assert capsys.readouterr().out.startswith(f"equal: {len(results[name])} trials from ")


def test_a_recording_that_was_cut_names_its_gap(results, folder, tmp_path, capsys):
    bag = tmp_path / "cut"
    shutil.copytree(bag_of(folder, "elevator"), bag)
    (file,) = bag.glob("*.mcap")
    with file.open("r+b") as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
        stream.seek(chunks[len(chunks) // 2].chunk_start_offset + 200)
        stream.write(bytes(2000))
    assert main(["replay", str(bag)]) == 1
    assert "run: session recover" in capsys.readouterr().err
    assert main(["recover", str(bag)]) == 0
    capsys.readouterr()
    assert main(["replay", f"{bag}_recovered"]) == 1
    lines = capsys.readouterr().out.splitlines()
    missing, tick = re.match(r"PROBLEM (\d+) samples missing after tick (\d+), ", lines[0]).groups()
    assert 0 < int(missing) < 1000 and int(tick) > 0
    assert lines[-1].endswith(f"{missing} samples missing")


def test_reaches_in_space_use_all_axes(results):
    found = results["reach_3d"]
    assert [result.assisted for result in found] == [True] * 2
    assert sum(result.reached for result in found) >= 1
    assert {result.missing for result in found} == {0}
    assert found[0].target.y != found[0].start.y and found[0].target.z != found[0].start.z


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
