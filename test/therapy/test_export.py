# SPDX-License-Identifier: Apache-2.0
"""Exports: tables that fit together, dates shifted, pseudonyms renamed, and the layout of BIDS."""

from __future__ import annotations

import csv
import json
import shutil
import stat
from contextlib import closing
from datetime import datetime, timedelta
from pathlib import Path

import pytest
from small_bag import MARCH, small_bag

from screw_module_ros.session_command import main
from screw_module_ros.therapy.record import Record
from screw_module_ros.therapy.recorded import read_sessions
from screw_module_ros.therapy.scores import Score, keep_scores

pytestmark = pytest.mark.long

OLD = next((Path(__file__).parents[1] / "data" / "bags").glob("P-7K3QX_*"))
DAY = 86400


@pytest.fixture
def folder(tmp_path):
    place = tmp_path / "sessions"
    place.mkdir()
    for day in range(2):
        small_bag(place, "P-7K3QX", MARCH + day * DAY, [{"sparc": -1.5}] * (day + 1))
    small_bag(place, "P-22222", MARCH, [{}], side="right")
    keep_scores(place, "P-7K3QX", [Score("2026-03-03T14:00:00+01:00", "FM_UE", 34.0)])
    return place


def exported(folder: Path, *options: str) -> Path:
    out = folder.parent / "out"
    assert main(["export", "--out", str(out), *options, str(folder)]) == 0
    return out


def table(file: Path) -> list[dict[str, str]]:
    with file.open() as stream:
        return list(csv.DictReader(stream))


def test_trials_sessions_and_scores_fit_together(folder):
    out = exported(folder)
    assert sorted(path.name for path in out.iterdir()) == ["P-22222", "P-7K3QX"]
    names = ("trials", "sessions", "scores")
    trials, sessions, scores = (table(out / "P-7K3QX" / f"{name}.csv") for name in names)
    numbers = [(row["session"], row["trial"]) for row in trials]
    assert numbers == [("1", "1"), ("2", "1"), ("2", "2")]
    assert [row["session"] for row in sessions] == ["1", "2"]
    first = sessions[0]
    assert (first["side"], first["outcome"], first["arm_weight"]) == ("left", "finished", "18.0")
    assert first["software"] == "0.1.0 0123456789ab" and first["trials"] == "1"
    assert datetime.fromisoformat(first["started"]).timestamp() == MARCH + 2
    assert scores == [{"patient": "P-7K3QX", "at": "2026-03-03T14:00:00.000+01:00",
                       "scale": "FM_UE", "value": "34.0"}]  # fmt: skip
    assert table(out / "P-22222" / "scores.csv") == []


def test_one_patient_may_be_exported_alone(folder):
    assert [path.name for path in exported(folder, "--patient", "P-22222").iterdir()] == ["P-22222"]


def test_all_dates_of_a_patient_are_shifted_by_one_number_of_days(folder):
    plain = {}
    for options in ((), ("--shift-dates",)):
        out = exported(folder, *options) / "P-7K3QX"
        dates = [
            datetime.fromisoformat(row[column])
            for name, column in (("trials", "started"), ("sessions", "started"), ("scores", "at"))
            for row in table(out / f"{name}.csv")
        ]
        stamps = [int(row["started_ns"]) for row in table(out / "trials.csv")]
        plain[options] = dates, stamps
    (dates, stamps), (moved, moved_ns) = plain.values()
    (shift,) = {later - earlier for earlier, later in zip(dates, moved, strict=True)}
    assert timedelta(days=-3651) < shift < timedelta(0) and shift.seconds == 0
    (shift_ns,) = {later - earlier for earlier, later in zip(stamps, moved_ns, strict=True)}
    assert shift_ns == shift.days * DAY * 10**9


def test_renamed_and_shifted_nothing_tells_who_it_was(folder):
    shutil.copytree(OLD, folder / OLD.name)
    out = exported(folder, "--rename", "--shift-dates", "--bids")
    files = [path for path in out.rglob("*") if path.is_file()]
    assert len(files) > 20
    for path in files:
        text = f"{path.relative_to(out)} {path.read_text()}"
        dates = ("2026-03-03", "2026-03-04", "2026-11-24")
        assert not [told for told in ("7K3QX", "22222", *dates, str(folder)) if told in text]
    names = {path.name for path in out.iterdir()} - {"bids"}
    assert len(names) == 2 and all(len(name) == 7 for name in names)


def test_bids_holds_the_samples_and_the_trials(folder):
    shutil.copytree(OLD, folder / OLD.name)
    out = exported(folder, "--bids", "--patient", "P-7K3QX") / "bids"
    with closing(Record(folder)) as record:
        number = [row["source"] for row in record.sessions("P-7K3QX")].index(OLD.name) + 1
    motion = out / "sub-7K3QX" / f"ses-{number:02}" / "motion"
    stem = f"sub-7K3QX_ses-{number:02}_task-elevator"
    assert {path.name.removeprefix(stem) for path in motion.iterdir()} == {
        "_events.tsv", "_tracksys-robot_motion.tsv", "_tracksys-robot_motion.json",
        "_tracksys-robot_channels.tsv",
    }  # fmt: skip
    (session,) = read_sessions(OLD)
    told = json.loads((motion / f"{stem}_tracksys-robot_motion.json").read_text())
    assert told["SamplingFrequency"] == pytest.approx(200.0) and told["TaskName"] == "elevator"
    lines = (motion / f"{stem}_tracksys-robot_motion.tsv").read_text().splitlines()
    rows = [list(map(float, line.split("\t"))) for line in lines]
    assert len(rows) == len(session.samples)
    last = session.samples[-1]
    assert rows[-1][1:] == pytest.approx(last[2:11], rel=1e-6)
    lasted = (last.time_ns - session.samples[0].time_ns) * 1e-9
    assert rows[-1][0] == pytest.approx(lasted, rel=1e-6)
    channels = (motion / f"{stem}_tracksys-robot_channels.tsv").read_text().splitlines()
    assert len(channels) == 1 + len(rows[0]) and channels[3] == "position_y\ty\tPOS\thand\tm"
    events = [line.split("\t") for line in (motion / f"{stem}_events.tsv").read_text().splitlines()]
    assert len(events) == 1 + len(session.trials)
    assert float(events[1][0]) + float(events[1][1]) <= float(events[2][0]) + 0.01
    assert (out / "participants.tsv").read_text().splitlines()[1] == "sub-7K3QX\tleft"
    assert {stat.S_IMODE(path.stat().st_mode) for path in out.rglob("*")} == {0o600, 0o700}
