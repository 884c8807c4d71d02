# SPDX-License-Identifier: Apache-2.0
"""A therapist's day in the browser, on the whole simulated robot, without a command line.

Three patients, left and right: a rest, a patient's stop with pain, a lost page, a spasm. Each event
is then looked for in bag, index and report.
"""

from __future__ import annotations

import csv
import io
import json
import re
from contextlib import closing
from types import SimpleNamespace

import pytest
import yaml
from bridge_stage import PROTOCOL, QUICK, Stage
from browser_pages import opened

from screw_module_ros.operator.robot import arm
from screw_module_ros.session_command import main
from screw_module_ros.therapy.record import Record
from screw_module_ros.therapy.recorded import read_sessions
from screw_module_ros.therapy.replay import replayed
from screw_module_ros.therapy.session import State
from screw_module_ros.trials.runner import recordings_in

pytestmark = [pytest.mark.graph, pytest.mark.long]

RESTS, STOPS, SPASM = "P-22222", "P-33333", "P-44444"
CRAMP = arm((0.0, 0.0, -0.09), 3.0, stiffness=1000.0, damping=80.0, traits={"follows": 0.0})
SIZES = {"therapist": (1280, 720), "patient": (1024, 768)}


class Day:
    """Both pages, and what a therapist and a patient do at them."""

    def __init__(self, stage, browser):
        self.stage, self.browser, self.errors = stage, browser, []
        self.screen = self.opened("patient")
        self.page = self.opened("therapist")

    def opened(self, role):
        return opened(self.browser, self.stage.page_of(role), self.errors, SIZES[role])

    def press(self, name):
        self.page.get_by_role("button", name=name).click()

    def sees(self, text):
        self.page.get_by_text(text).first.wait_for()

    def begins(self, patient, side):
        """Seat a patient: pseudonym, arm, protocol, the list, Start."""
        self.sees("The robot is ready, the torque is on.")
        self.page.get_by_label("Pseudonym of the patient").fill(patient)
        self.page.get_by_label("Arm", exact=True).select_option(side)
        self.page.get_by_label("Protocol", exact=True).select_option(PROTOCOL)
        for box in self.page.locator(".checks input").all():
            box.check()
        self.press("Start")

    def tells(self, pain, tired):
        """Touch the numbers that the patient's screen asks for."""
        for question, value in (("How much pain", pain), ("How tired", tired)):
            self.screen.get_by_text(question).wait_for()
            self.screen.get_by_role("button", name=str(value), exact=True).click()
        self.screen.locator("#ask").wait_for(state="hidden")

    def is_saved(self, patient):
        """Wait until the bag of the newest session is closed, and told so; return it."""
        self.stage.ask(lambda robot: robot.wait_until(
            lambda: list(self.stage.folder.glob(f"bags/{patient}_*/metadata.yaml"))
            and not self.stage.states[-1].recorded, 60.0, "the bag is not closed"))  # fmt: skip
        (bag,) = self.stage.folder.glob(f"bags/{patient}_*/metadata.yaml")
        return bag.parent


def lived(day):
    """Let the day pass; return the bags by patient."""
    bags = {}
    day.begins(RESTS, "left")
    day.tells(2, 1)
    day.sees("a rest,")
    day.screen.get_by_text("It goes on in").wait_for()
    day.sees("Running, movement 5")
    day.sees("Finished:")
    day.tells(3, 2)
    bags[RESTS] = day.is_saved(RESTS)

    day.begins(STOPS, "right")
    day.tells(1, 1)
    day.sees("Running, movement 2")
    day.screen.keyboard.press("Space")
    day.sees("the patient asked")
    day.tells(6, 2)
    day.sees("He tells pain 6 of 10, tiredness 2 of 10. Go on?")
    day.press("Resume")
    day.sees("Running, movement 3")
    day.page.close()  # the tab is lost
    day.stage.wait_for_state(State.PAUSED, "silent for 2 s")
    day.page = day.opened("therapist")
    day.sees("the therapist's page has been silent for 2 s")
    day.press("Resume")
    day.sees("Finished:")
    day.tells(2, 4)
    bags[STOPS] = day.is_saved(STOPS)

    day.begins(SPASM, "left")
    day.tells(0, 0)
    day.sees("Running, movement 2")
    day.stage.ask(lambda robot: robot.set_arm(CRAMP))
    day.sees("the arm pulls hard")
    day.stage.ask(lambda robot: robot.set_arm(QUICK))
    day.tells(4, 1)
    day.sees("Go on?")
    day.press("End session")
    day.sees("Ended before its time: the therapist ended it")
    day.tells(4, 1)
    bags[SPASM] = day.is_saved(SPASM)
    return bags


@pytest.fixture(scope="module")
def day(tmp_path_factory, browser):
    """The whole day: bags by patient, their folder, errors of the pages."""
    folder = tmp_path_factory.mktemp("day")
    bags = folder / "bags"
    extra = [*recordings_in(bags), "-p", "amplifier:stop_reaction:=brake"]
    stage = Stage(folder, extra=extra)
    file = folder / PROTOCOL
    content = yaml.safe_load(file.read_text())
    content["blocks"][0]["rest"] = {"every": 4, "seconds": 10}
    file.write_text(yaml.safe_dump(content))
    with stage:
        lives = Day(stage, browser)
        found = lived(lives)
        lives.page.close()
        lives.screen.close()
    with closing(Record(bags)) as record:
        record.update()
        assert record.notes == []
        rows = {row["pseudonym"]: dict(row) for row in record.sessions()}
        scores = {who: [(row["scale"], row["value"]) for row in record.scores(who)] for who in rows}
    return SimpleNamespace(
        folder=bags, bags=found, rows=rows, scores=scores, errors=lives.errors,
        sessions={who: read_sessions(bag)[0] for who, bag in found.items()},
    )  # fmt: skip


def test_the_pages_had_no_error(day):
    assert day.errors == []


@pytest.mark.parametrize(("patient", "side", "outcome", "stops"), [
    (RESTS, "left", "finished", ["a rest"]),
    (STOPS, "right", "finished",
     ["a rest", "the patient asked", "the therapist's page has been silent for 2 s"]),
    (SPASM, "left", "aborted", ["the arm pulls hard", "the therapist ended it"]),
])  # fmt: skip
def test_every_event_is_in_bag_index_and_report(day, tmp_path, patient, side, outcome, stops):
    session, row = day.sessions[patient], day.rows[patient]
    acts = [act.reason for act in session.acts if act.state in (State.PAUSED, State.ABORTED)]
    assert sorted(acts) == stops and session.side == side
    assert (row["side"], row["outcome"], sorted(json.loads(row["stops"]))) == (side, outcome, stops)
    assert main(["report", str(day.folder), "--patient", patient, "--out", str(tmp_path)]) == 0
    report = (tmp_path / patient / "report.html").read_text().replace("&#39;", "'")
    assert all(stop in report for stop in stops)


@pytest.mark.parametrize(("patient", "pain", "told", "said"), [
    (RESTS, [2, 3], "pain 2( → 3)? of 10; tiredness 1( → 2)? of 10", None),
    (STOPS, [1, 6, 2],
     "pain 1 → 6( → 2)? of 10; tiredness 1 → 2( → 4)? of 10; the therapist went on", 1.0),
    (SPASM, [0, 4, 4], "pain 0 → 4 of 10; tiredness 0 → 1 of 10; the therapist ended it for that",
     0.0),
])  # fmt: skip
def test_what_each_patient_told_is_kept(day, tmp_path, patient, pain, told, said):
    """The last answers may come when the bag is closed: then scores alone have them."""
    scores = day.scores[patient]
    assert [value for scale, value in scores if scale.startswith("pain")] == pain
    assert dict(scores).get("went_on") == said
    assert main(["report", str(day.folder), "--patient", patient, "--out", str(tmp_path)]) == 0
    assert re.search(told, (tmp_path / patient / "report.html").read_text())


def test_what_was_done_at_the_pages_is_in_each_bag(day, capsys):
    """From the pseudonym on: what came before the recording began is in its bag too."""
    assert main(["actions", str(day.folder)]) == 0
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    of = {who: [(row["page"], row["action"]) for row in rows if row["patient"] == who]
          for who in day.bags}  # fmt: skip
    for own in of.values():
        assert own.index(("therapist", "count")) < own.index(("therapist", "start"))
        assert [own.count(("patient", "answer")) >= 2, own.count(("therapist", "start"))] == [1, 1]
    assert of[STOPS].count(("therapist", "resume")) == 2
    assert ("patient", "pause_by_patient") in of[STOPS] and ("therapist", "abort") in of[SPASM]
    times = [float(row["seconds"]) for row in rows if row["action"] in ("start", "resume")]
    assert len(times) == 5 and min(times) >= 0.0
    assert {row["outcome"] for row in rows} <= {"", "undone"}


@pytest.mark.parametrize("patient", [RESTS, STOPS, SPASM])
def test_each_session_is_computed_again_with_its_rests_and_pauses(day, patient):
    assert replayed(day.sessions[patient]).problems == []
