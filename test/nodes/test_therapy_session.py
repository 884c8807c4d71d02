# SPDX-License-Identifier: Apache-2.0
"""Therapy sessions on the whole graph against the rig: slot, trials, pause, records, replay.

One run: a session with a pause, one that loses its recording, then every other kind of trial. Each
recording is computed again.
"""

from __future__ import annotations

import csv
import math
import os
import re
import shutil
from pathlib import Path

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from mcap.reader import make_reader
from screw_module_msgs.msg import TherapySlot, TherapyState
from screw_module_msgs.srv import StartTherapy
from therapy_run import therapy_run

from screw_module_ros.operator.robot import RobotError
from screw_module_ros.recording.bag import METADATA_FILE
from screw_module_ros.resources import resource_path
from screw_module_ros.session_command import main
from screw_module_ros.software import software
from screw_module_ros.therapy.recorded import read_sessions
from screw_module_ros.therapy.replay import replayed
from screw_module_ros.therapy.session import State

pytestmark = [pytest.mark.graph, pytest.mark.long]

PATIENT, OTHER = "P-7K3QX", "P-22222"
TRIALS = 8
SPACE, EVALUATION = "reach_3d", "evaluation"
KINDS = ["reach", "reach", "circle", "hold", "resisted", "strength"]


def short_protocol(folder):
    """Two targets, one circuit without and one with assistance."""
    content = yaml.safe_load(resource_path("params/therapy/clock_adaptive.yaml").read_text())
    targets = {"layout": "clock", "count": 2, "distance": 0.08}
    content["blocks"] = [
        {**content["blocks"][index], "circuits": 1, "targets": targets} for index in (0, 1)
    ]
    content["guidance"]["duration"] = 1.0
    content["rules"].update(wait=0.7, give_up=4.0, hold=0.1, prepare_duration=1.0)
    file = folder / "short.yaml"
    file.write_text(yaml.safe_dump(content))
    return file


def shorter(folder, name):
    """Write a protocol with one block of one target, or all of them, in little time."""
    content = yaml.safe_load(resource_path(f"params/therapy/{name}.yaml").read_text())
    blocks = content["blocks"] if name == EVALUATION else content["blocks"][1:2]
    for block in blocks:
        block["circuits"] = 1
        block["targets"] = {**block["targets"], "count": 1, "rounds": 1}
        if "duration" in block:
            block["duration"] = 4.0 if block["kind"] == "circle" else 1.0
    content["blocks"] = blocks
    content["rules"].update(
        hit_radius=0.02, wait=0.5, give_up=4.0, hold=0.1, settle_time=0.05, prepare_duration=1.2
    )
    file = folder / f"{name}_short.yaml"
    file.write_text(yaml.safe_dump(content))
    return file


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """A session paused once, and the others; everything that was told, and the bags."""
    folder = tmp_path_factory.mktemp("therapy")
    protocol = str(short_protocol(folder))
    told = {"refused": []}
    with therapy_run(folder, "-p", "sim_rig:speed:=0.0") as (robot, patient):
        for request in (
            StartTherapy.Request(protocol=protocol, patient="Erika Musterfrau"),
            StartTherapy.Request(protocol="dancing", patient=PATIENT),
            StartTherapy.Request(protocol="/etc/passwd", patient=PATIENT),
        ):
            with pytest.raises(RobotError) as refused:
                robot.ask(StartTherapy, "therapy_session/start", request)
            told["refused"].append(str(refused.value))
        told["bad slot"] = diagnosed_after_bad_slot(robot)
        start(robot, protocol)
        patient.until(lambda: len(patient.results) >= 2, 60.0, "no trial comes to its end")
        robot.enable_plane(False)
        patient.until_state(TherapyState.PAUSED)
        told["paused"] = patient.states[-1].reason
        robot.enable_plane()
        robot.pause(0.3)
        robot.trigger("therapy_session/resume")
        told["recorded"], told["bag"] = finished(robot, patient, folder, "clock_adaptive")
        told["unrecorded"] = paused_without_recording(robot, patient, protocol)
        told.update(
            states=[*patient.states], results=[*patient.results], changes=[*patient.changes]
        )
        for name in (SPACE, EVALUATION):
            patient.results.clear()
            start(robot, str(shorter(folder, name)))
            _, bag = finished(robot, patient, folder, name)
            told[name] = [*patient.results], bag
    if keep := os.environ.get("KEEP_THERAPY_BAG"):
        shutil.copytree(told["bag"], keep)
    return told


def start(robot, protocol, patient=PATIENT):
    """Start a recorded session, once the node has heard that the last one's bag is closed.

    The bag is closed a moment before the recorder's answer comes; until then the node refuses.
    """
    request = StartTherapy.Request(protocol=protocol, patient=patient, record=True)

    def begun():
        answer = robot.call(StartTherapy, "therapy_session/start", request)
        assert answer.success or "is being closed" in answer.message, answer.message
        return answer.success

    robot.wait_until(begun, 30.0, "the last recording is never closed")


def finished(robot, patient, folder, protocol):
    """Play to the end of a session and of its recording; return whether it was recorded, the bag.

    A session that is aborted or paused instead never comes to its end.
    """
    patient.until_state(TherapyState.RUNNING)
    patient.until_state(TherapyState.FINISHED, 120.0)
    recorded = patient.states[-1].recorded
    patient.until(lambda: not patient.states[-1].recorded, 30.0, "the recording goes on")
    (bag,) = folder.glob(f"{PATIENT}_{protocol}_*")
    robot.wait_until((bag / METADATA_FILE).exists, 30.0, "the bag is not closed")
    return recorded, bag


def paused_without_recording(robot, patient, protocol):
    """Start another patient's session, stop its recording; return what is told then, and then."""
    start(robot, protocol, OTHER)
    patient.until(lambda: patient.states[-1].recorded, 60.0, "it is not recorded")
    robot.stop_recording()
    patient.until_state(TherapyState.PAUSED)
    paused = patient.states[-1]
    robot.trigger("therapy_session/resume")
    patient.until_state(TherapyState.RUNNING)
    running = patient.states[-1]
    robot.trigger("therapy_session/abort")
    patient.until_state(TherapyState.ABORTED)
    return paused, running


def diagnosed_after_bad_slot(robot):
    """Publish a slot that cannot be; return what both controllers say of it."""
    publisher = robot.node.create_publisher(TherapySlot, "therapy/slot", 1)
    slot = TherapySlot(planar=True, vertical=True, duration=math.nan)
    said = {}

    def heard(message):
        for status in message.status:
            values = {value.key: value.value for value in status.values}
            said[status.name] = values.get("slot refused", "")

    subscription = robot.node.create_subscription(DiagnosticArray, "/diagnostics", heard, 50)

    def refused():
        publisher.publish(slot)
        return all("duration" in said.get(name, "") for name in ("manus", "impedance_controller"))

    robot.wait_until(refused, 20.0, "nobody refuses a slot of no duration")
    robot.node.destroy_subscription(subscription)
    robot.node.destroy_publisher(publisher)
    return said


def test_every_trial_is_told_once_and_in_order(session):
    results = session["results"]
    assert [result.trial for result in results] == list(range(1, TRIALS + 1))
    assert {result.patient for result in results} == {PATIENT}
    assert [result.assisted for result in results] == [False] * 4 + [True] * 4
    assert sum(result.reached for result in results) >= 6
    assert all(result.rate == pytest.approx(200.0, rel=0.01) for result in results)
    assert all(result.missing == 0 for result in results)
    moved = [result for result in results if result.moved]
    assert all(0.05 < result.peak_speed < 0.6 for result in moved)
    assert all(math.isfinite(result.sparc) for result in moved)


def test_the_assistance_is_told_with_its_reason(session):
    (change,) = session["changes"]
    assert (change.block, change.circuit) == (2, 1)
    assert change.duration_before == 1.0
    assert "metric" in change.reason


def test_torque_off_pauses_and_says_why(session):
    assert session["paused"] == "the plane's torque is off"


def test_names_and_unknown_protocols_are_refused(session):
    name, protocol, elsewhere = session["refused"]
    assert "not a pseudonym" in name and "Erika" not in name
    assert "no protocol" in protocol and "dancing" in protocol
    assert "lies outside of" in elsewhere


def test_screens_see_every_phase(session):
    seen = {state.phase for state in session["states"] if state.state == TherapyState.RUNNING}
    assert {TherapyState.PREPARE, TherapyState.WAIT, TherapyState.MOVING, TherapyState.REACHED} <= (
        seen
    )
    told = [state.patient for state in session["states"] if state.definition]
    assert told == [PATIENT, OTHER], "once each"


def test_the_recording_ends_with_its_session(session):
    """Else it would hold the next patient's movements under this one's name."""
    assert session["recorded"], "it was recorded until its end"
    (recorded,) = read_sessions(session["bag"])
    assert recorded.acts[-1].state == State.FINISHED


def test_no_log_of_ros_names_the_patient(session):
    """Recorded sessions, pauses, a recording that was ended: `session forget` reaches no log."""
    logs = "".join(path.read_text() for path in Path(os.environ["ROS_LOG_DIR"]).rglob("*.log"))
    assert "session running" in logs
    assert PATIENT not in logs.replace(f"like {PATIENT}", ""), "an example of the form may stand"


def test_a_recording_that_ends_pauses_its_session(session):
    paused, running = session["unrecorded"]
    assert paused.reason.startswith("the recording has ended: ")
    assert not paused.recorded
    assert not running.recorded, "it goes on, as it was told to, and says that it is not recorded"


def test_the_recording_gives_the_same_results_bit_for_bit(session):
    (recorded,) = read_sessions(session["bag"])
    assert recorded.patient == PATIENT
    assert [row["trial"] for row in recorded.trials] == list(range(1, TRIALS + 1))
    found = replayed(recorded)
    assert found.problems == []
    assert len(found.results) == TRIALS
    assert recorded.changes[0]["reason"] == session["changes"][0].reason


def test_the_commands_read_the_bag(session, tmp_path, capsys):
    bag, out = str(session["bag"]), tmp_path / "out"
    assert main(["replay", bag]) == 0
    assert capsys.readouterr().out.startswith(f"equal: {TRIALS} trials")
    assert main(["export", "--out", str(out), bag]) == 0
    lines = (out / PATIENT / "trials.csv").read_text().splitlines()
    assert len(lines) == 1 + TRIALS and lines[1].startswith(f"{PATIENT},clock_adaptive,")
    assert main(["report", "--out", str(out), bag]) == 0
    names = sorted(file.name for file in (out / PATIENT).iterdir())
    assert names == ["columns.csv", "report.html", "scores.csv", "sessions.csv", "trials.csv"]
    (row,) = csv.DictReader((out / PATIENT / "sessions.csv").open())
    assert (row["patient"], row["outcome"], row["simulated"]) == (PATIENT, "finished", "1")
    assert row["software"] == software() and row["law"].startswith("thesis ")


@pytest.mark.parametrize("name", [SPACE, EVALUATION])
def test_each_is_computed_again_from_its_recording_bit_for_bit(session, name, capsys):
    results, bag = session[name]
    assert main(["replay", str(bag)]) == 0
    assert capsys.readouterr().out.startswith(f"equal: {len(results)} trials from ")


def test_a_recording_that_was_cut_names_its_gap(session, tmp_path, capsys):
    bag = tmp_path / "cut"
    shutil.copytree(session[SPACE][1], bag)
    (file,) = bag.glob("*.mcap")
    with file.open("r+b") as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
        stream.seek(chunks[len(chunks) // 2].chunk_start_offset + 200)
        stream.write(bytes(2000))
    assert main(["replay", str(bag)]) == 1
    assert "run: session recover" in capsys.readouterr().err
    assert main(["recover", str(bag)]) == 1, "less than the bag states"
    capsys.readouterr()
    assert main(["replay", f"{bag}_recovered"]) == 1
    lines = capsys.readouterr().out.splitlines()
    missing, tick = re.match(r"PROBLEM (\d+) samples missing after tick (\d+), ", lines[0]).groups()
    assert 0 < int(missing) < 1000 and int(tick) > 0
    assert lines[-1].endswith(f"{missing} samples missing")


def test_reaches_in_space_use_all_axes(session):
    found, _ = session[SPACE]
    assert [result.assisted for result in found] == [True] * 2
    assert sum(result.reached for result in found) >= 1
    assert {result.missing for result in found} == {0}
    assert found[0].target.y != found[0].start.y and found[0].target.z != found[0].start.z
    assert all(math.isfinite(result.sparc) for result in found if result.moved)


def test_every_part_of_the_evaluation_has_its_figures(session):
    found, _ = session[EVALUATION]
    assert [result.kind for result in found] == KINDS
    by_kind = {result.kind: result for result in found}
    assert by_kind["reach"].moved and math.isfinite(by_kind["reach"].log_jerk)
    assert by_kind["circle"].moved and by_kind["circle"].size > 0.0
    assert 0.0 < by_kind["hold"].hold_deviation < 0.03
    assert 0.01 < by_kind["resisted"].pm4 < 0.16, "[m]; held back by a spring"
    assert by_kind["strength"].largest_force > 2.0, "[N]; it pushes against what holds it"
    assert not any(result.assisted for result in found)


def test_a_slot_that_cannot_be_is_refused_by_both_controllers(session):
    for name in ("manus", "impedance_controller"):
        assert session["bad slot"][name].startswith("therapy/slot: Slot: duration = nan")
