# SPDX-License-Identifier: Apache-2.0
"""A forgotten patient is found nowhere; a backup brings back, moves and merges."""

from __future__ import annotations

import io
import shutil
import sys
import zipfile
from contextlib import closing
from pathlib import Path

import pytest
from small_bag import MARCH, small_bag

from screw_module_ros.session_command import main
from screw_module_ros.therapy.arm_weights import ArmWeight, arms_of, keep, weights_file
from screw_module_ros.therapy.record import Record
from screw_module_ros.therapy.scores import Score, keep_scores

pytestmark = pytest.mark.long

DAY = 86400
HER = "P-7K3QX"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Two patients with sessions, scores, weighed arms, reports and an export."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    place = tmp_path / "sessions"
    place.mkdir()
    for patient in (HER, "P-22222"):
        for day in range(2):
            small_bag(place, patient, MARCH + day * DAY, [{"duration": 1.0 + day}])
        keep_scores(place, patient, [Score("2026-03-03T14:00:00+01:00", "FM_UE", 34.0)])
        keep(weights_file(), patient, "left", ArmWeight(18.4, 1.2, 1_796_000_000))
        out = str(tmp_path / "out")
        assert main(["report", str(place), "--patient", patient, "--out", out]) == 0
    assert main(["export", "--out", str(tmp_path / "more"), str(place)]) == 0
    return place


def sessions(folder: Path) -> list[str]:
    with closing(Record(folder)) as record:
        record.update()
        return sorted(row["source"] for row in record.sessions())


def rows(folder: Path) -> list[str]:
    with closing(Record(folder)) as record:
        record.update()
        return list(record.base.iterdump())


def forget(folder, monkeypatch, typed=HER, patient=HER):
    monkeypatch.setattr(sys, "stdin", io.StringIO(f"{typed}\n"))
    return main(["forget", patient, "--folder", str(folder)])


def found(root: Path, text: str) -> list[str]:
    """Return the names below a folder in which a text stands, in name or content."""
    return [
        str(path) for path in root.rglob("*")
        if text in path.name or path.is_file() and text.encode() in path.read_bytes()
    ]  # fmt: skip


def test_a_forgotten_patient_is_found_nowhere(folder, monkeypatch, capsys):
    """Below sessions, state and reports: not in the record, nor in what it freed."""
    small_bag(folder, HER, MARCH + 9 * DAY, closed=False)
    shutil.copytree(folder / sessions(folder)[-1], folder / "renamed")
    named = folder.parent / f"for_{HER}"
    assert main(["export", "--out", str(named), str(folder)]) == 0
    shutil.rmtree(named)  # the log alone names it
    assert len(found(folder.parent, HER)) > 8
    kept = rows(folder)
    capsys.readouterr()
    assert forget(folder, monkeypatch) == 0
    told = capsys.readouterr().out
    assert str(folder / "renamed") in told and str(folder.parent / "more" / HER) in told
    assert "backups" in told and "printed" in told
    assert found(folder.parent, HER) == []
    assert rows(folder) == [line for line in kept if HER not in line and "renamed" not in line]
    assert len(sessions(folder)) == 2 and arms_of(weights_file(), "P-22222").left is not None
    assert (folder.parent / "out" / "P-22222" / "report.html").exists()


def test_forgetting_asks_again(folder, monkeypatch, capsys):
    before = found(folder.parent, HER)
    for typed in ("", "P-22222", "yes"):
        assert forget(folder, monkeypatch, typed) == 1
    assert capsys.readouterr().out.count("nothing was deleted") == 3
    assert found(folder.parent, HER) == before


def test_a_bag_of_a_forgotten_patient_that_comes_back_does_not_count(folder, monkeypatch, capsys):
    name = next(name for name in sessions(folder) if name.startswith(HER))
    shutil.copytree(folder / name, folder.parent / name)
    assert forget(folder, monkeypatch) == 0
    (folder.parent / name).rename(folder / name)
    assert len(sessions(folder)) == 2
    (folder / "record.db").unlink()
    assert main(["index", str(folder)]) == 1
    assert "was forgotten, and does not count" in capsys.readouterr().err
    assert forget(folder, monkeypatch) == 0
    assert found(folder.parent, HER) == []


def test_a_bag_that_others_share_is_named_and_stays(folder, monkeypatch, capsys):
    """A bag of an older version may hold several patients."""
    with closing(Record(folder)) as record:
        record.update()
        row = dict(record.sessions("P-22222")[0])
        shared = next(name for name in sessions(folder) if name.startswith(HER))
        record.base.execute(
            "INSERT INTO session VALUES (:source, :number, :pseudonym, :side, :begun, :utc_offset,"
            ":protocol, :level, :protocol_sha256, :simulated, :outcome, :stops, :robot,"
            ":software, :law, :support, :arm_weight, :stamp_ns, :trials, :minutes)",
            row | {"source": shared, "number": 7},
        )  # fmt: skip
    assert forget(folder, monkeypatch) == 0
    assert f"{folder / shared}, which holds others too" in capsys.readouterr().out
    assert (folder / shared).exists()
    with closing(Record(folder)) as record:
        assert record.sessions(HER) == []


def test_a_backup_brings_everything_back(folder, capsys):
    kept, file = rows(folder), folder.parent / "backup.zip"
    assert main(["backup", str(file), "--folder", str(folder)]) == 0
    assert "6 bags and files of scores" in capsys.readouterr().out
    assert file.stat().st_mode & 0o077 == 0
    assert main(["backup", str(file), "--folder", str(folder)]) == 1, "never overwritten"
    empty = folder.parent / "empty"
    empty.mkdir()
    assert main(["restore", str(file), "--folder", str(empty)]) == 0
    assert rows(empty) == kept
    modes = {path.stat().st_mode & 0o077 for path in empty.rglob("*")}
    assert modes == {0}
    assert main(["restore", str(file), "--folder", str(empty)]) == 0
    assert "0 bags came" in capsys.readouterr().out and rows(empty) == kept


def test_records_of_two_robots_are_merged_and_a_patient_is_moved(folder, capsys):
    other = folder.parent / "other"
    other.mkdir()
    small_bag(other, HER, MARCH + 30 * DAY, [{}])
    keep_scores(other, HER, [Score("2026-04-03T14:00:00+02:00", "FM_UE", 40.0)])
    file = folder.parent / "moved.zip"
    assert main(["backup", str(file), "--patient", HER, "--folder", str(folder)]) == 0
    assert not [name for name in zipfile.ZipFile(file).namelist() if not name.startswith(HER)]
    assert main(["restore", str(file), "--folder", str(other)]) == 0
    with closing(Record(other)) as record:
        record.update()
        assert len(record.sessions(HER)) == 3
        assert [row["value"] for row in record.scores(HER)] == [34.0, 40.0]


def test_a_forgotten_patient_is_not_restored(folder, monkeypatch, capsys):
    file = folder.parent / "backup.zip"
    assert main(["backup", str(file), "--folder", str(folder)]) == 0
    assert forget(folder, monkeypatch) == 0
    assert main(["restore", str(file), "--folder", str(folder)]) == 0
    assert "its patient was forgotten: left out" in capsys.readouterr().err
    assert found(folder, HER) == []
    again = folder.parent / "again.zip"
    assert main(["backup", str(again), "--folder", str(folder)]) == 0
    other = folder.parent / "other"
    other.mkdir()
    assert main(["restore", str(again), "--folder", str(other)]) == 0
    assert main(["restore", str(file), "--folder", str(other)]) == 0
    assert found(other, HER) == [], "the digest went with the backup"


@pytest.mark.parametrize("names", [["../x"], ["/x"], ["a/b/c"], [".hidden"], ["a/.b"]])
def test_no_name_of_a_backup_leads_out_of_the_folder(folder, names, capsys):
    file = folder.parent / "bad.zip"
    with zipfile.ZipFile(file, "w") as packed:
        for name in names:
            packed.writestr(name, "x")
    before = sorted(folder.parent.rglob("*"))
    assert main(["restore", str(file), "--folder", str(folder)]) == 1
    assert "is no whole backup" in capsys.readouterr().err
    assert sorted(folder.parent.rglob("*")) == before


def test_a_damaged_backup_brings_nothing(folder, capsys):
    file, empty = folder.parent / "backup.zip", folder.parent / "empty"
    assert main(["backup", str(file), "--folder", str(folder)]) == 0
    data = bytearray(file.read_bytes())
    data[len(data) // 3] ^= 0xFF
    file.write_bytes(data)
    empty.mkdir()
    assert main(["restore", str(file), "--folder", str(empty)]) == 1
    assert "is no whole backup" in capsys.readouterr().err and sessions(empty) == []
