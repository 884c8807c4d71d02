# SPDX-License-Identifier: Apache-2.0
"""A game that a therapist chooses, in the browser on the whole simulated robot, and its record."""

from __future__ import annotations

import csv
from contextlib import closing

import pytest
from bridge_stage import PATIENT, Stage
from browser_pages import opened

from screw_module_ros.session_command import main
from screw_module_ros.therapy.record import Record
from screw_module_ros.therapy.recorded import read_sessions
from screw_module_ros.therapy.replay import replayed
from screw_module_ros.trials.runner import recordings_in

pytestmark = [pytest.mark.graph, pytest.mark.long]


def test_a_chosen_game_is_played_and_counts_as_dose(tmp_path, browser):
    bags, errors = tmp_path / "bags", []
    with Stage(tmp_path, extra=recordings_in(bags)) as stage:
        screen = opened(browser, stage.page_of("patient"), errors)
        page = opened(browser, stage.page_of("therapist"), errors)
        page.get_by_text("The robot is ready, the torque is on.").wait_for()
        page.get_by_label("Pseudonym of the patient").fill(PATIENT)
        page.get_by_label("Arm", exact=True).select_option("right")
        page.get_by_label("Protocol", exact=True).select_option("fruit")
        page.get_by_label("Minutes", exact=True).fill("1")
        page.get_by_label("Ask for pain").uncheck()
        for box in page.locator(".checks input").all():
            box.check()
        page.get_by_role("button", name="Start").click()
        page.get_by_text("near, minute 1 of 1: the patient plays").wait_for()
        screen.locator("body:not([data-score='0'])").wait_for()
        page.get_by_text("Finished: Pick fruit, 1 min.").wait_for()
        stage.ask(lambda robot: robot.wait_until(
            lambda: list(bags.glob(f"{PATIENT}_*/metadata.yaml")), 60.0,
            "the bag is not closed"))  # fmt: skip
        page.close()
        screen.close()
    assert errors == []
    (bag,) = bags.glob(f"{PATIENT}_fruit_*")
    (session,) = read_sessions(bag)
    (minute,) = session.trials
    assert minute["kind"] == "game" and minute["score"] > 0.0 and minute["mean_speed"] > 0.005
    assert replayed(session).problems == []
    with closing(Record(bags)) as record:
        record.update()
        (row,) = record.sessions(PATIENT)
        assert (row["protocol"], row["level"], row["trials"]) == ("fruit", "near", 1)
        assert row["minutes"] == pytest.approx(1.0, abs=0.01)
    out = ["--patient", PATIENT, "--out", str(tmp_path / "out")]
    assert main(["report", str(bags), *out]) == main(["export", str(bags), *out]) == 0
    report = (tmp_path / "out" / PATIENT / "report.html").read_text()
    assert "score of the game" in report and "near" in report
    with (tmp_path / "out" / PATIENT / "trials.csv").open() as stream:
        (kept,) = csv.DictReader(stream)
    assert float(kept["score"]) == minute["score"]
