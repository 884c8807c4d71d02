# SPDX-License-Identifier: Apache-2.0
"""The record is what its folder holds: made again equal, whole after a kill, one copy counts."""

from __future__ import annotations

import hashlib
import itertools
import json
import os
import shutil
import signal
import sqlite3
import stat
from contextlib import closing
from datetime import datetime
from pathlib import Path

import pytest
from small_bag import MARCH, protocol, small_bag

from screw_module_ros.recording.bag import BagError
from screw_module_ros.session_command import main
from screw_module_ros.therapy import record as record_module
from screw_module_ros.therapy.measures import COLUMNS, DEFINITIONS, MEASURES
from screw_module_ros.therapy.record import Record, alone
from screw_module_ros.therapy.recorded import read_sessions
from screw_module_ros.therapy.scores import Score, keep_scores
from screw_module_ros.therapy.session import State

pytestmark = pytest.mark.long

OLD = next((Path(__file__).parents[1] / "data" / "bags").glob("P-7K3QX_*"))
DAY = 86400


@pytest.fixture
def folder(tmp_path):
    """Two patients, one of them twice, scores, and a recording without a session."""
    place = tmp_path / "sessions"
    place.mkdir()
    small_bag(place, "P-7K3QX", MARCH, [{"sparc": -1.5}, {"sparc": -1.6}])
    small_bag(place, "P-7K3QX", MARCH + DAY, [{"sparc": -1.4}])
    small_bag(place, "P-22222", MARCH, [{"sparc": -2.0}], side="right")
    keep_scores(place, "P-7K3QX", [Score("2026-03-03T14:00:00+01:00", "FM_UE", 34.0)])
    shutil.copytree(OLD.parent / "demo", place / "demo")
    return place


def dump(folder: Path, thorough: bool = True) -> list[str]:
    """Bring the record up to date; return all of it."""
    with closing(Record(folder)) as record:
        record.update(thorough)
        return list(record.base.iterdump())


def counted(folder: Path, pseudonym: str = "") -> list[str]:
    with closing(Record(folder)) as record:
        record.update()
        return [row["source"] for row in record.sessions(pseudonym)]


def test_a_session_has_what_its_bag_tells(folder):
    dump(folder)
    with closing(Record(folder)) as record:
        first, second = map(dict, record.sessions("P-7K3QX"))
        assert first["begun"] == MARCH + 2.0 and second["begun"] == MARCH + DAY + 2.0
        offset = datetime.fromtimestamp(MARCH).astimezone().utcoffset().total_seconds()
        assert (first["side"], first["utc_offset"]) == ("left", offset)
        assert (first["protocol"], first["outcome"]) == ("clock_adaptive", "finished")
        assert first["software"] == "0.1.0 0123456789ab" and first["arm_weight"] == 18.0
        assert (first["law"], first["robot"]) == ("force 1.0", "SIM-0001")
        rows = record.trials(record.sessions("P-7K3QX")[0])
        assert [row["sparc"] for row in rows] == [-1.5, -1.6] and rows[0]["started"]
        (score,) = record.scores("P-7K3QX")
        assert (score["scale"], score["value"]) == ("FM_UE", 34.0)
        (other,) = record.sessions("P-22222")
        assert other["side"] == "right"


def test_both_files_are_their_owners_alone(folder):
    umask = os.umask(0)
    try:
        dump(folder)
    finally:
        os.umask(umask)
    for name in ("record.db", "access.db"):
        assert stat.S_IMODE((folder / name).stat().st_mode) == 0o600


def test_made_again_it_is_the_same(folder):
    kept = dump(folder)
    assert any("FM_UE" in line for line in kept)
    (folder / "record.db").unlink()
    assert dump(folder) == kept
    assert dump(folder, thorough=False) == kept


def test_in_whatever_order_bags_come_it_is_the_same(folder, tmp_path):
    """A clinic indexes each evening; who makes the record again does it at once."""
    kept = dump(folder)
    other = tmp_path / "other"
    other.mkdir()
    for path in sorted(folder.iterdir(), reverse=True):
        if path.is_dir():
            shutil.copytree(path, other / path.name)
            dump(other, thorough=False)
    shutil.copy(folder / "P-7K3QX_scores.json", other)
    assert dump(other, thorough=False) == kept


def test_what_is_taken_away_or_changed_is_so_in_the_record(folder):
    kept = dump(folder)
    bag = folder / counted(folder, "P-22222")[0]
    bag.rename(folder.parent / bag.name)
    assert counted(folder, "P-22222") == []
    keep_scores(folder, "P-7K3QX", [Score("2026-04-03T14:00:00+02:00", "FM_UE", 40.0)])
    with closing(Record(folder)) as record:
        record.update()
        assert [row["value"] for row in record.scores("P-7K3QX")] == [34.0, 40.0]
    (folder.parent / bag.name).rename(bag)
    (folder / "P-7K3QX_scores.json").unlink()
    keep_scores(folder, "P-7K3QX", [Score("2026-03-03T14:00:00+01:00", "FM_UE", 34.0)])
    assert dump(folder, thorough=False) == kept


def test_a_copy_counts_once_and_the_fuller_one(folder, capsys):
    """A bag that was cut off has less than its recovered copy; a backup has the same."""
    bag = folder / counted(folder, "P-22222")[0]
    shutil.copytree(bag, folder / "A_backup")
    dump(folder)
    assert counted(folder, "P-22222") == ["A_backup"]
    longer = small_bag(folder.parent / "other", "P-22222", MARCH, [{"sparc": -2.0}] * 2)
    longer.rename(folder / f"{bag.name}_recovered")
    assert main(["index", str(folder)]) == 0
    assert counted(folder, "P-22222") == [f"{bag.name}_recovered"]
    told = capsys.readouterr()
    assert told.err.splitlines() == [
        f"NOTE {name} is a copy of {bag.name}_recovered: left out"
        for name in ("A_backup", bag.name)
    ]
    assert told.out == "3 sessions of 2 patients\n"
    shutil.rmtree(folder / f"{bag.name}_recovered")
    assert counted(folder, "P-22222") == ["A_backup"]


def test_two_sessions_in_one_second_are_two(folder):
    small_bag(folder / "x", "P-7K3QX", MARCH + 0.4, [{}]).rename(folder / "again")
    assert len(counted(folder, "P-7K3QX")) == 3


def test_a_session_before_which_the_clock_was_set_back_stands_where_its_clock_said(folder):
    bag = small_bag(folder, "P-7K3QX", MARCH - 400 * DAY, [{}])
    assert counted(folder, "P-7K3QX")[0] == bag.name


def test_a_bag_without_trials_counts(folder):
    aborted = ((State.RUNNING, ""), (State.PAUSED, "torque"), (State.ABORTED, "ended"))
    bag = small_bag(folder, "P-33333", MARCH, acts=aborted)
    dump(folder)
    with closing(Record(folder)) as record:
        (row,) = record.sessions("P-33333")
        assert (row["source"], row["outcome"], row["trials"]) == (bag.name, "aborted", 0)
        assert json.loads(row["stops"]) == {"ended": 1, "torque": 1}


def test_an_unfinished_bag_is_named_and_its_recovered_copy_counts(folder, capsys):
    bag = small_bag(folder, "P-33333", MARCH, [{}], closed=False)
    assert main(["index", str(folder)]) == 1
    assert f"session recover {bag}" in capsys.readouterr().err
    assert counted(folder, "P-33333") == []
    assert main(["recover", str(bag)]) == 0
    assert counted(folder, "P-33333") == [f"{bag.name}_recovered"]


def test_a_bag_of_an_older_version_has_empty_places(folder):
    shutil.copytree(OLD, folder / OLD.name)
    dump(folder)
    with closing(Record(folder)) as record:
        (row,) = (row for row in record.sessions() if row["source"] == OLD.name)
        assert (row["side"], row["software"]) == ("", "")
        assert row["support"] is None and row["utc_offset"] is None
        trials, (read,) = record.trials(row), read_sessions(OLD)
        assert trials[0]["jerk"] is None and trials[0]["duration"] == read.trials[0]["duration"]
        assert len(trials) == len(read.trials) == row["trials"]


def test_scores_that_cannot_be_read_are_named(folder, capsys):
    (folder / "P-33333_scores.json").write_text('{"scores": [{"at": "today"}]}')
    assert main(["index", str(folder)]) == 1
    assert "P-33333_scores.json: scores[0].scale is missing" in capsys.readouterr().err


def test_other_definitions_of_the_measures_make_it_again(folder, monkeypatch):
    kept = dump(folder)
    with closing(sqlite3.connect(folder / "record.db")) as base:
        base.execute("UPDATE trial SET row = replace(row, '-1.5', '-9.5')")
        base.commit()
    assert dump(folder, thorough=False) != kept, "known bags are not read again"
    with closing(sqlite3.connect(folder / "record.db")) as base:
        base.execute(f"PRAGMA user_version = {record_module.DEFINITIONS + 1}")
    assert dump(folder, thorough=False) == kept


def test_who_writes_second_is_refused(folder, capsys):
    with alone(folder):
        assert main(["index", str(folder)]) == 1
    assert "another program writes the record" in capsys.readouterr().err
    assert main(["index", str(folder)]) == 0
    with alone(folder):  # nothing is new, so nothing is written
        assert len(counted(folder)) == 3


def test_a_file_that_is_no_record_is_said_so(folder, capsys):
    (folder / "record.db").write_text("no database, but text of some length" * 100)
    assert main(["index", str(folder)]) == 1
    assert f"the record of {folder} cannot be used: " in capsys.readouterr().err


def killed(folder: Path, statement: int) -> bool:
    """Index in a child that is killed at a statement of the database; return whether it was."""
    child = os.fork()
    if child == 0:
        try:
            with closing(Record(folder)) as record:
                count = itertools.count(1)
                record.base.set_trace_callback(
                    lambda _: next(count) == statement and os.kill(os.getpid(), signal.SIGKILL)
                )
                record.update(thorough=True)
        finally:
            os._exit(0)
    return os.WIFSIGNALED(os.waitpid(child, 0)[1])


def test_a_kill_at_any_statement_leaves_no_half_session(folder, tmp_path):
    """Each source is there with all of its rows, or not at all; the next index ends the work."""
    whole = dump(folder)
    with closing(Record(folder)) as record:
        trials = {row["source"]: len(record.trials(row)) for row in record.sessions()}
    (folder / "record.db").unlink()
    for statement in itertools.count(1):
        if not killed(folder, statement):
            break
        with closing(sqlite3.connect(folder / "record.db")) as base:
            assert base.execute("PRAGMA integrity_check").fetchone() == ("ok",)
            assert base.execute("PRAGMA foreign_key_check").fetchall() == []
            if base.execute("PRAGMA user_version").fetchone()[0]:
                found = dict(base.execute(
                    "SELECT name, count(trial) FROM source LEFT JOIN trial ON source = name"
                    " WHERE name LIKE 'P-%' AND name NOT LIKE '%scores.json' GROUP BY name"
                ))  # fmt: skip
                assert found.items() <= trials.items()
        if statement % 7 == 0:
            assert dump(folder, thorough=False) == whole
        for name in ("record.db", "record.db-journal"):
            (folder / name).unlink(missing_ok=True)
    assert statement > 40, "every statement of the indexing was a moment of death"


def test_five_hundred_patients_are_searched_by_an_index(folder):
    """What is asked of one patient's sessions and trials is found, not searched for."""
    dump(folder)
    with closing(Record(folder)) as record:
        asked = []
        record.base.set_trace_callback(asked.append)
        for row in record.sessions("P-7K3QX"):
            record.trials(row)
        record.scores("P-7K3QX")
        record.base.set_trace_callback(None)
        explained = (record.base.execute(f"EXPLAIN QUERY PLAN {sql}") for sql in asked)
        plans = [row["detail"] for rows in explained for row in rows]
    whole = tuple(f"SCAN {table}" for table in ("session", "trial", "score", "source"))
    assert not [plan for plan in plans if plan.startswith(whole)]
    assert sum(plan.startswith("SEARCH ") for plan in plans) >= 3


def test_who_read_what_is_kept_a_year(folder, capsys, monkeypatch):
    assert main(["index", str(folder)]) == 0
    assert main(["due", "--older", "1d", str(folder)]) == 0
    out = str(folder.parent / "out")
    assert main(["export", "--out", out, "--patient", "P-22222", str(folder)]) == 0
    capsys.readouterr()
    assert main(["access", str(folder)]) == 0
    lines = [line.split()[2:] for line in capsys.readouterr().out.splitlines()]
    assert lines == [["index"], ["due"], ["export", "P-22222", out]]
    monkeypatch.setattr(record_module.time, "time", lambda: os.times().elapsed + 4e9)
    assert main(["due", "--older", "1d", str(folder)]) == 0
    with closing(Record(folder)) as record:
        (row,) = record.base.execute("SELECT what FROM kept.access")
        assert row["what"] == "due"


def test_an_export_of_bags_beside_a_record_is_noted_there(folder):
    dump(folder)
    bag = folder / counted(folder, "P-22222")[0]
    assert main(["export", "--out", str(folder.parent / "out"), str(bag)]) == 0
    with closing(Record(folder)) as record:
        (row,) = record.base.execute("SELECT * FROM kept.access")
        assert (row["what"], row["pseudonym"]) == ("export", "P-22222")


def test_patients_who_are_due(folder, capsys):
    small_bag(folder, "P-33333", datetime.now().timestamp() - 5 * DAY)
    assert main(["due", "--older", "6d", str(folder)]) == 0
    told = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in told] == ["P-22222", "P-7K3QX"]
    assert "2026-03-04" in told[1]
    with pytest.raises(SystemExit):
        main(["due", "--older", "soon", str(folder)])


def test_bags_in_memory_are_refused_where_they_cannot_be_read(folder):
    with closing(Record()) as record, pytest.raises(BagError, match="no therapy session"):
        record.add(folder / "demo", "demo", "")


def test_one_protocol_has_one_hash(folder):
    other = protocol(count=3)
    small_bag(folder, "P-33333", MARCH, [{}], definition=other)
    dump(folder)
    with closing(Record(folder)) as record:
        hashes = {row["pseudonym"]: row["protocol_sha256"] for row in record.sessions()}
    assert hashes["P-33333"] != hashes["P-7K3QX"] == hashes["P-22222"]


def test_a_table_that_means_something_else_has_another_number():
    """Renew the digest together with `DEFINITIONS`, unless only words of a definition changed."""
    told = [(m.name, m.unit, m.factor, m.kinds, m.text) for m in MEASURES]
    found = hashlib.sha256(repr((told, COLUMNS)).encode()).hexdigest()[:12]
    assert (DEFINITIONS, found) == (3, "36f29100039f")
