# SPDX-License-Identifier: Apache-2.0
"""Events of sessions for an investigator's form, and what people did at the pages."""

from __future__ import annotations

import csv
import io
from datetime import datetime

import pytest
from rcl_interfaces.msg import Log
from small_bag import MARCH, small_bag

from screw_module_ros.session_command import main
from screw_module_ros.therapy.session import PATIENT_ASKED, PULLS_HARD, THERAPIST_PAUSED, State

STOP = "the robot has stopped: force: 170 N"
ACTS = [
    (State.RUNNING, ""), (State.PAUSED, PULLS_HARD), (State.RUNNING, ""),
    (State.PAUSED, PATIENT_ASKED), (State.RUNNING, ""), (State.PAUSED, THERAPIST_PAUSED),
    (State.RUNNING, ""), (State.ABORTED, STOP),
]  # fmt: skip


def events(folder, capsys, *options):
    capsys.readouterr()
    assert main(["events", "--folder", str(folder), *options]) == 0
    return list(csv.DictReader(io.StringIO(capsys.readouterr().out)))


def keep_score(folder, scale, value, after_s, patient="P-7K3QX"):
    at = datetime.fromtimestamp(MARCH + after_s).astimezone().isoformat()
    arguments = ["score", "--folder", str(folder), "--at", at, patient, scale, str(value)]
    assert main(arguments) == 0


def test_each_event_has_its_minute_and_its_bag(tmp_path, capsys):
    offs = [(61.0, True), (61.01, True), (62.0, False), (181.0, True)]
    bag = small_bag(tmp_path, acts=ACTS, hand_off=offs)
    keep_score(tmp_path, "pain_before", 3, -60)
    keep_score(tmp_path, "pain_after", 6, 241)
    keep_score(tmp_path, "tired_after", 9, 241)
    found = events(tmp_path, capsys)
    assert [(each["event"], each["detail"]) for each in found] == [
        ("spasm", PULLS_HARD), ("patient's stop", PATIENT_ASKED), ("pause", THERAPIST_PAUSED),
        ("stop", STOP), ("hand off", ""), ("hand off", ""), ("pain", "pain_after 6"),
    ]  # fmt: skip
    assert [each["minute"] for each in found] == ["0.0"] * 4 + ["1.0", "3.0", "4.0"]
    assert {each["bag"] for each in found} == {bag.name}
    assert {each["patient"] for each in found} == {"P-7K3QX"}
    begun = datetime.fromisoformat(found[0]["begun"])
    assert begun.timestamp() == MARCH + 1 and begun.tzinfo is not None


def test_pain_of_another_day_is_none_of_this_session(tmp_path, capsys):
    small_bag(tmp_path)
    keep_score(tmp_path, "pain_after", 9, 3 * 86400)
    assert events(tmp_path, capsys) == []


def test_of_one_patient_alone_and_who_asked_is_noted(tmp_path, capsys):
    small_bag(tmp_path, "P-7K3QX", acts=ACTS[:2])
    small_bag(tmp_path, "P-9M4TR", acts=ACTS[:2])
    assert {each["patient"] for each in events(tmp_path, capsys)} == {"P-7K3QX", "P-9M4TR"}
    (one,) = events(tmp_path, capsys, "--patient", "P-9M4TR")
    assert one["patient"] == "P-9M4TR"
    assert main(["access", str(tmp_path)]) == 0
    assert "events P-9M4TR" in capsys.readouterr().out


DONE, REFUSED = Log.INFO, Log.WARN
ACTIONS = [
    (-59.0, "therapist", "count", DONE), (-30.0, "therapist", "start", REFUSED),
    (-3.0, "patient", "language", DONE), (-2.0, "therapist", "start", DONE),
    (1.001, "patient", "pause_by_patient", DONE), (8.0, "therapist", "resume", REFUSED),
    (9.0, "therapist", "resume", DONE), (20.0, "therapist", "set support.force", DONE),
    (25.0, "therapist", "pause", DONE), (26.0, "therapist", "set support.force", DONE),
    (34.0, "therapist", "resume", DONE), (50.0, "therapist", "rest", DONE),
    (61.0, "therapist", "resume", REFUSED), (70.0, "therapist", "abort", DONE),
]  # fmt: skip
OUTCOMES = [
    ("", ""), ("refused", ""), ("", ""), ("", "57.0"), ("", ""), ("refused", ""), ("", "8.0"),
    ("undone", ""), ("undone", ""), ("", ""), ("", "33.0"), ("", ""), ("refused", ""), ("", ""),
]  # fmt: skip


@pytest.mark.parametrize("of_bag", [True, False])
def test_each_action_tells_what_became_of_it_and_how_long_its_task_took(tmp_path, capsys, of_bag):
    bag = small_bag(tmp_path, acts=ACTS[:2], actions=ACTIONS)
    assert main(["actions", str(bag if of_bag else tmp_path)]) == 0
    found = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    told = [(each["page"], each["action"]) for each in found]
    assert told == [(page, action) for _, page, action, _ in ACTIONS]
    assert [(each["outcome"], each["seconds"]) for each in found] == OUTCOMES
    assert [each["minute"] for each in found][:5] == ["-1.0", "-0.52", "-0.07", "-0.05", "0.0"]
    assert {each["bag"] for each in found} == {str(bag) if of_bag else bag.name}


def test_a_bag_of_an_older_version_has_no_actions(tmp_path, capsys):
    assert main(["actions", str(small_bag(tmp_path))]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "patient,begun,minute,page,action,outcome,seconds,bag"
    ]
