# SPDX-License-Identifier: Apache-2.0
"""Recorded sessions give the same numbers bit for bit, or the replay reports what is missing."""

import csv

import pytest
from session_bag import played, short_text, write_bag
from simulated_patient import FEEBLE, HEALTHY, SHAKING

from screw_module_ros import graph
from screw_module_ros.recording.bag import BagError
from screw_module_ros.session_command import main
from screw_module_ros.therapy.protocol_file import sha256
from screw_module_ros.therapy.recorded import read_sessions
from screw_module_ros.therapy.replay import replayed

pytestmark = pytest.mark.long

CLOCK = short_text()


@pytest.fixture(scope="module")
def healthy():
    return played(HEALTHY, 1, CLOCK)


@pytest.fixture(scope="module")
def bag(healthy, tmp_path_factory):
    return write_bag(tmp_path_factory.mktemp("bags") / "healthy", [healthy])


@pytest.mark.parametrize(
    ("person", "name"), [(SHAKING, "clock_adaptive"), (FEEBLE, "reach_3d"), (HEALTHY, "elevator")]
)
def test_three_sessions_are_equal_bit_for_bit(person, name, tmp_path, capsys):
    folder = write_bag(tmp_path / name, [played(person, 2, short_text(name))])
    (recorded,) = read_sessions(folder)
    assert recorded.protocol.name == name
    assert replayed(recorded).problems == []
    assert main(["replay", str(folder)]) == 0
    assert capsys.readouterr().out.startswith(f"equal: {len(recorded.trials)} trials from ")


def test_changes_of_assistance_are_computed_again_too(bag):
    """The last one shows in no later trial."""
    (recorded,) = read_sessions(bag)
    assert len(recorded.changes) == 1 and replayed(recorded).problems == []
    other = [{**recorded.changes[0], "duration": 0.7}]
    (problem,) = replayed(recorded._replace(changes=other)).problems
    assert problem.startswith("assistance after circuit 1 of block 2: duration 0.7 recorded, ")
    (problem,) = replayed(recorded._replace(changes=[])).problems
    assert problem.endswith("replayed, but its change was not recorded")
    twice = [*recorded.changes, {**recorded.changes[0], "circuit": 2}]
    (problem,) = replayed(recorded._replace(changes=twice)).problems
    assert problem.endswith("recorded, but the replay does not change it")


def test_a_cut_bag_names_its_gap(healthy, tmp_path, capsys):
    at = len(healthy.samples) // 2
    gone = {sample.sequence for sample in healthy.samples[at : at + 30]}
    folder = write_bag(tmp_path / "cut", [healthy], lambda sample: sample.sequence not in gone)
    assert main(["replay", str(folder)]) == 1
    lines = capsys.readouterr().out.splitlines()
    before = healthy.samples[at - 1].sequence
    assert lines[0].startswith(f"PROBLEM 30 samples missing after tick {before}, ")
    assert lines[-1].endswith("30 samples missing")


def test_the_next_patient_in_the_same_bag_is_another_session(healthy, tmp_path):
    """Two sessions in one bag: the figures of one must not appear in the other."""
    other = played(SHAKING, 5, CLOCK, "P-22222", begin_s=1000)
    again = played(FEEBLE, 6, CLOCK, begin_s=2000)
    found = read_sessions(write_bag(tmp_path / "long", [healthy, other, again]))
    assert [each.patient for each in found] == ["P-7K3QX", "P-22222", "P-7K3QX"]
    assert [len(each.trials) for each in found] == [8, 8, 8]
    assert [replayed(each).problems for each in found] == [[], [], []]
    assert len({each.trials[0]["path_error"] for each in found}) == 3


def test_the_one_robot_with_a_session_is_found(healthy, tmp_path):
    """A bag of two robots: the first topics in it were taken, whichever robot they were of."""
    idle = healthy._replace(robot="/arm/", told=[
        (at, topic, type(message)()) for at, topic, message in healthy.told
        if topic == graph.THERAPY_STATE
    ])  # fmt: skip
    of_left = healthy._replace(robot="/left/")
    (found,) = read_sessions(write_bag(tmp_path / "one", [idle, of_left]))
    assert len(found.trials) == 8 and replayed(found).problems == []
    both = write_bag(tmp_path / "two", [healthy._replace(robot="/arm/"), of_left])
    with pytest.raises(BagError, match="sessions of 2 robots .*/arm/, /left/.*: record each"):
        read_sessions(both)


def test_the_record_names_its_protocol_by_a_hash(bag):
    (recorded,) = read_sessions(bag)
    assert recorded.protocol_sha256 == sha256(CLOCK)


def test_another_protocol_than_was_carried_out_is_refused(healthy, tmp_path, capsys):
    (time_ns, topic, state), *rest = healthy.told
    changed = type(state)(
        state=state.state, state_since=state.state_since, patient=state.patient,
        protocol=state.protocol, definition_sha256=state.definition_sha256,
        definition=state.definition.replace("hit_radius: 0.01", "hit_radius: 0.02"),
    )  # fmt: skip
    tampered = healthy._replace(told=[(time_ns, topic, changed), *rest])
    folder = write_bag(tmp_path / "tampered", [tampered])
    with pytest.raises(BagError, match="not the one that was carried out: its SHA-256 is"):
        read_sessions(folder)
    assert main(["replay", str(folder)]) == 1
    assert "SHA-256" in capsys.readouterr().err


def test_the_export_tells_targets_and_what_its_columns_mean(bag, tmp_path):
    assert main(["export", "--out", str(tmp_path), str(bag)]) == 0
    folder = tmp_path / "P-7K3QX"
    rows = list(csv.DictReader((folder / "trials.csv").open()))
    first, second = rows[:2]
    assert [first[f"target_{axis}"] for axis in "xyz"] == ["0.0", "0.14", "0.18"]
    assert [second[f"target_{axis}"] for axis in "xyz"] == ["0.0", "0.0", "0.18"]
    assert {row["protocol_sha256"] for row in rows} == {sha256(CLOCK)}
    columns = {row["column"]: row for row in csv.DictReader((folder / "columns.csv").open())}
    assert float(columns["path_error"]["factor"]) == 1e3 and columns["path_error"]["unit"] == "mm"
    assert set(columns) <= set(first)


def test_a_bag_that_is_named_twice_counts_once(bag, tmp_path):
    """Two patterns of a shell may have it both: its trials counted double in every median."""
    (tmp_path / "link").symlink_to(bag)
    bags = [str(bag), f"{bag}/", str(tmp_path / "link")]
    assert main(["export", "--out", str(tmp_path), *bags]) == 0
    rows = list(csv.DictReader((tmp_path / "P-7K3QX" / "trials.csv").open()))
    assert [int(row["trial"]) for row in rows] == list(range(1, 9))


@pytest.mark.parametrize(("command", "name"), [("export", "trials.csv"), ("report", "report.html")])
def test_what_cannot_be_written_is_said_so(bag, tmp_path, command, name, capsys):
    """A full disk, too, gave a traceback."""
    (tmp_path / "P-7K3QX" / name).mkdir(parents=True)
    assert main([command, "--out", str(tmp_path), str(bag)]) == 1
    assert f"--out {tmp_path}: " in capsys.readouterr().err
