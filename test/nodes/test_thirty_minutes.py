# SPDX-License-Identifier: Apache-2.0
"""Thirty simulated minutes of a therapist with three patients, faster than real time (`fast_day`).

A rest, a patient's stop with pain, a lost page, a spasm. Each is then looked for in bag, index and
report. No browser: the pages are clients that speak their protocol.
"""

from __future__ import annotations

import csv
import io
import json
from contextlib import closing
from types import SimpleNamespace

import pytest
import yaml
from node_classes import making_nodes
from wired import Topics

pytest.importorskip("gymnasium", reason="the compiled loop is of the package's extra gym")

from fast_day import BEGUN_NS, FastDay, Page, Recorder, Robot, S

from screw_module_ros.clock import ManualClock
from screw_module_ros.nodes import bridge_gateway, therapy_recording, therapy_session
from screw_module_ros.nodes.therapy_recording import SessionRecording
from screw_module_ros.plant.patient import ArmSettings
from screw_module_ros.resources import resource_path
from screw_module_ros.session_command import main
from screw_module_ros.therapy.protocol_file import parse_protocol
from screw_module_ros.therapy.record import Record
from screw_module_ros.therapy.recorded import read_sessions
from screw_module_ros.therapy.replay import replayed
from screw_module_ros.therapy.session import State

pytestmark = [pytest.mark.long, pytest.mark.timeout(900)]

MINUTES = 30.0
RESTS, STOPS, SPASM = "P-22222", "P-33333", "P-44444"
SEATING_S = 180.0
CRAMP = ArmSettings(target=(0.0, 0.0, -0.09), duration=3.0, stiffness=1000.0, damping=80.0,
                    traits=("follows",), values=(0.0,))  # fmt: skip
RELAXED = ArmSettings(patient="healthy")
PAIN, TIREDNESS, ALL_TICKED = 1, 2, 63
PROTOCOL = "day.yaml"


def protocol_of_the_day():
    """Return the YAML of a circuit of the clock game, long enough for ten minutes."""
    content = yaml.safe_load(resource_path("params/therapy/clock_adaptive.yaml").read_text())
    rest = {"every": 128, "seconds": 20}
    content["blocks"] = [{**content["blocks"][0], "circuits": 16, "rest": rest}]
    content["name"], content["title"] = "day", "Clock of a day"
    return yaml.safe_dump(content)


def begins(day, patient, side):
    """Seat a patient, and press Start once he has told pain and tiredness."""
    day.wait(SEATING_S)
    assert day.page.call("session_recorder/count", patient=patient)["sessions"] == 0
    started = day.page.call(
        "therapy_session/start", protocol=PROTOCOL, patient=patient, side=side, checks=ALL_TICKED,
        record=True,
    )  # fmt: skip
    assert started["success"], started["message"]


def tells(day, pain, tired):
    """Touch the numbers that the patient's screen asks for, some seconds each."""
    for asks, value in ((PAIN, pain), (TIREDNESS, tired)):
        day.until(lambda asks=asks: day.screen.state["asks"] == asks)
        day.wait(4.0)
        day.screen.publish("therapy/answer", data=16 * asks + value)
    day.until(lambda: not day.screen.state["asks"])


def comes_to(day, state, reason=""):
    day.until(lambda: day.page.state.get("state") == state and reason in day.page.state["reason"])


def moves(day, trial):
    day.until(lambda: day.page.state.get("state") == State.RUNNING
              and day.page.state["trial"] >= trial)  # fmt: skip


def presses(day, service):
    answer = day.page.call(f"therapy_session/{service}")
    assert answer["success"], answer["message"]


def lived(day):
    """Let the day pass."""
    begins(day, RESTS, "left")
    tells(day, 2, 1)
    moves(day, 40)
    presses(day, "rest")
    comes_to(day, State.PAUSED, "a rest")
    moves(day, 41)
    comes_to(day, State.FINISHED)
    tells(day, 3, 2)

    begins(day, STOPS, "right")
    tells(day, 1, 1)
    moves(day, 30)
    assert day.screen.call("therapy_session/pause_by_patient")["success"]
    comes_to(day, State.PAUSED, "the patient asked")
    tells(day, 6, 2)
    day.wait(45.0)
    presses(day, "resume")
    moves(day, 80)
    day.page = None  # the tab is lost
    day.wait(30.0)
    day.page = Page(day, "therapist")
    comes_to(day, State.PAUSED, "the therapist's page has been silent for 2 s")
    presses(day, "resume")
    comes_to(day, State.FINISHED)
    tells(day, 2, 4)

    begins(day, SPASM, "left")
    tells(day, 0, 0)
    moves(day, 20)
    day.robot.change(CRAMP)
    comes_to(day, State.PAUSED, "the arm pulls hard")
    day.robot.change(RELAXED)
    tells(day, 4, 1)
    day.wait(30.0)
    presses(day, "abort")
    comes_to(day, State.ABORTED, "the therapist ended it")
    tells(day, 4, 1)
    day.wait(SEATING_S)


@pytest.fixture(scope="module")
def day(tmp_path_factory):
    """The whole day: bags by patient, their folder, how long it was."""
    folder = tmp_path_factory.mktemp("thirty")
    (folder / PROTOCOL).write_text(protocol_of_the_day())
    clock = ManualClock(BEGUN_NS)
    recorder = Recorder(folder / "bags", clock)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(therapy_session, "SessionRecording",
                      lambda node, _: SessionRecording(recorder, clock))  # fmt: skip
        for module in (therapy_recording, bridge_gateway):
            patch.setattr(module, "is_served", lambda node, client: True)
        with making_nodes(patch) as make:
            node = make("therapy_session", "-p", f"folder:={folder}")
            ends = Topics(node)
            node.trigger_configure()
            node.clock, node.requests.ask = clock, lambda act: act()
            node.trigger_activate()
            robot = Robot(parse_protocol(protocol_of_the_day(), "test"), 1)
            lives = FastDay(node, ends, recorder, clock, robot,
                            lambda who: len(list((folder / "bags").glob(f"{who}_*"))))  # fmt: skip
            lived(lives)
            node.close()
    bags = {bag.name[:7]: bag for bag in (folder / "bags").iterdir() if bag.is_dir()}
    with closing(Record(folder / "bags")) as record:
        record.update()
        assert record.notes == []
        rows = {row["pseudonym"]: dict(row) for row in record.sessions()}
        scores = {who: [(row["scale"], row["value"]) for row in record.scores(who)] for who in rows}
    return SimpleNamespace(
        folder=folder / "bags", rows=rows, scores=scores, seconds=(clock.time_ns - BEGUN_NS) / S,
        sessions={who: read_sessions(bag)[0] for who, bag in bags.items()},
    )  # fmt: skip


def test_it_was_a_day_of_thirty_minutes(day):
    assert day.seconds >= 60.0 * MINUTES
    assert {who: row["side"] for who, row in day.rows.items()} == {
        RESTS: "left", STOPS: "right", SPASM: "left"
    }  # fmt: skip


@pytest.mark.parametrize(("patient", "outcome", "stops", "events"), [
    (RESTS, "finished", ["a rest"] * 2, ["rest"] * 2),
    (STOPS, "finished",
     ["a rest", "the patient asked", "the therapist's page has been silent for 2 s"],
     ["pain", "patient's stop", "rest", "stop"]),
    (SPASM, "aborted", ["the arm pulls hard", "the therapist ended it"], ["spasm", "stop"]),
])  # fmt: skip
def test_every_event_is_in_bag_index_and_report(
    day, tmp_path, capsys, patient, outcome, stops, events
):
    session, row = day.sessions[patient], day.rows[patient]
    acts = [act.reason for act in session.acts if act.state in (State.PAUSED, State.ABORTED)]
    assert sorted(acts) == stops
    assert (row["outcome"], sorted(json.loads(row["stops"]))) == (outcome, sorted(set(stops)))
    assert replayed(session).problems == []
    assert main(["report", str(day.folder), "--patient", patient, "--out", str(tmp_path)]) == 0
    report = (tmp_path / patient / "report.html").read_text().replace("&#39;", "'")
    assert all(stop in report for stop in stops)
    capsys.readouterr()
    assert main(["events", "--folder", str(day.folder), "--patient", patient]) == 0
    told = csv.DictReader(io.StringIO(capsys.readouterr().out))
    assert sorted(each["event"] for each in told) == events


@pytest.mark.parametrize(("patient", "pain", "said"), [
    (RESTS, [2, 3], None), (STOPS, [1, 6, 2], 1.0), (SPASM, [0, 4, 4], 0.0),
])  # fmt: skip
def test_what_each_patient_told_is_kept(day, patient, pain, said):
    scores = day.scores[patient]
    assert [value for scale, value in scores if scale.startswith("pain")] == pain
    assert dict(scores).get("went_on") == said


def test_what_was_done_at_the_pages_is_in_each_bag(day, capsys):
    """Seating and pauses take as long as the script says; the press of Start is in its own bag."""
    assert main(["actions", str(day.folder)]) == 0
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    told = {who: [f"{row['page']} {row['action']}" for row in rows if row["patient"] == who]
            for who in day.rows}  # fmt: skip
    seated, answered = ["therapist count", "therapist start"], ["patient answer"] * 2
    assert told == {
        RESTS: [*seated, *answered, "therapist rest"],
        STOPS: [*seated, *answered, "patient pause_by_patient", *answered, "therapist resume",
                "therapist resume"],
        SPASM: [*seated, *answered, *answered, "therapist abort"],
    }  # fmt: skip
    waited = [float(row["seconds"]) for row in rows if row["action"] == "resume"]
    assert waited[0] >= 45.0 and waited[1] >= 28.0 and {row["outcome"] for row in rows} == {""}
