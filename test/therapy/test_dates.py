# SPDX-License-Identifier: Apache-2.0
"""A session has the clinic's date, whoever reads it and wherever, in report and export."""

from __future__ import annotations

import csv
import json
import time
from contextlib import closing
from datetime import datetime, timedelta

import pytest
import yaml
from session_bag import played, short_text, write_bag
from simulated_patient import HEALTHY

from screw_module_ros.session_command import main
from screw_module_ros.therapy.record import Record, local
from screw_module_ros.therapy.recorded import read_sessions
from screw_module_ros.therapy.report_content import date_of

DEFINITION = short_text(count=1)
MARCH = 1_772_539_500  # 2026-03-03 12:05 UTC
ZONES = ("UTC", "Europe/Berlin", "Asia/Tokyo", "America/Los_Angeles")


@pytest.fixture(params=ZONES)
def reader_in(request, monkeypatch):
    """Whoever reads the bag has a computer in this zone."""
    monkeypatch.setenv("TZ", request.param)
    time.tzset()
    yield request.param
    monkeypatch.undo()
    time.tzset()


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Return a maker of bags: when it began [s], what its notes tell, the folder's name."""
    known = {}

    def make(begin_s: int, begun: str = "", sim: bool | None = None, name: str = "bag"):
        key = (begin_s, begun, sim, name)
        if key not in known:
            notes = {"clock": {"begun": begun}} if begun else {}
            if sim is not None:
                notes["parameters"] = {"/endpoint_state": json.dumps({"use_sim_time": sim})}
            told = played(HEALTHY, 1, DEFINITION, begin_s=begin_s)
            known[key] = write_bag(tmp_path_factory.mktemp("dates") / name, [told], notes=notes)
        return known[key]

    return make


DATES = {
    "clinic in Berlin": (
        (MARCH, "2026-03-03T13:05:00+01:00", False), "2026-03-03 13:05 +01:00"
    ),
    "clinic in Kathmandu": (
        (MARCH, "2026-03-03T17:50:00+05:45", False), "2026-03-03 17:50 +05:45"
    ),
    "an older bag": ((MARCH,), "2026-03-03 12:05"),
    "a board without a clock": (
        (100, "1970-01-01T00:01:40+00:00", False), "1970-01-01 00:01 +00:00"
    ),
    "simulated": ((900, "2026-03-03T13:05:00+01:00", True), "2026-03-03 13:05 +01:00, simulated"),
    "simulated for longer than a year": (
        (2 * 365 * 86400, "2026-03-03T13:05:00+01:00", True), "2026-03-03 13:05 +01:00, simulated"
    ),
    "an older simulated bag": (
        (900, "", None, "P-7K3QX_elevator_2026_03_03-13_05_00"), "2026-03-03 13:05, simulated"
    ),
    "a simulated bag of another recorder, named in UTC": (
        (900, "", None, "P-7K3QX_elevator_2026_03_03-12_05_00Z"), "2026-03-03 12:05, simulated"
    ),
    "an older simulated bag that was renamed": ((900,), "simulated"),
}  # fmt: skip


@pytest.mark.parametrize(("made", "date"), DATES.values(), ids=DATES)
def test_the_date_is_that_of_the_clinic_in_whatever_zone_it_is_read(
    made, date, recorded, reader_in
):
    """One bag was dated 13:05, 12:05 or 21:05; seconds after the start of a board were no date."""
    (session,) = read_sessions(recorded(*made))
    assert date_of(session) == date


def test_a_beginning_that_is_no_text_is_none(tmp_path):
    """It was a traceback."""
    told = played(HEALTHY, 1, DEFINITION, begin_s=MARCH)
    bag = write_bag(tmp_path / "bag", [told])
    content = yaml.safe_load((bag / "metadata.yaml").read_text())
    custom = content["rosbag2_bagfile_information"]["custom_data"]
    custom["screw_module_ros/clock"] = '{"begun": 5}'
    (bag / "metadata.yaml").write_text(yaml.safe_dump(content))
    assert read_sessions(bag)[0].recorded_at is None


def test_sessions_stand_by_date_in_whatever_order_they_are_given(recorded, reader_in):
    """Simulated ones by the beginning of their recording, though their time begins anew."""
    older = recorded(MARCH - 600)
    simulated = recorded(900, "2026-03-03T13:05:00+01:00", True)
    again = recorded(300, "2026-03-03T13:15:00+01:00", True)
    later = recorded(MARCH + 1500, "2026-03-03T13:30:00+01:00", False)
    undated = recorded(900)
    expected = [undated, older, simulated, again, later]
    for given in (expected, expected[::-1]):
        with closing(Record()) as record:
            for bag in given:
                record.add(bag, str(bag), "")
            assert [record.path(row) for row in record.sessions()] == expected
            assert local(record.sessions()[2]).isoformat() == "2026-03-03T13:05:00+01:00"


def exported(bag, out, *options):
    assert main(["export", "--out", str(out), *options, str(bag)]) == 0
    return (out / "P-7K3QX" / "trials.csv").read_bytes()


def test_the_export_has_the_date_of_each_trial_in_iso_8601(recorded, tmp_path, reader_in):
    bag = recorded(MARCH, "2026-03-03T13:05:00+01:00", False)
    text = exported(bag, tmp_path).decode()
    rows = list(csv.DictReader(text.splitlines()))
    assert rows
    for row in rows:
        begun = datetime.fromisoformat(row["started"])
        assert begun.utcoffset() == timedelta(hours=1)
        assert begun.timestamp() == pytest.approx(int(row["started_ns"]) * 1e-9, abs=1e-3)
        assert row["simulated"] == "0"


def test_simulated_trials_count_from_the_beginning_of_their_recording(recorded, tmp_path):
    bag = recorded(900, "2026-03-03T13:05:00+01:00", True)
    rows = list(csv.DictReader(exported(bag, tmp_path).decode().splitlines()))
    first, second = (datetime.fromisoformat(row["started"]) for row in rows[:2])
    passed = (int(rows[1]["started_ns"]) - int(rows[0]["started_ns"])) * 1e-9
    assert first.isoformat() == "2026-03-03T13:05:00+01:00"
    assert (second - first).total_seconds() == pytest.approx(passed, abs=2e-3)
    assert rows[0]["simulated"] == "1"


def test_an_export_with_decimal_commas_holds_the_same_numbers(recorded, tmp_path):
    bag = recorded(MARCH, "2026-03-03T13:05:00+01:00", False)
    plain = list(csv.DictReader(exported(bag, tmp_path / "a").decode().splitlines()))
    text = exported(bag, tmp_path / "b", "--decimal-comma").decode()
    comma = list(csv.DictReader(text.splitlines(), delimiter=";"))
    assert [row.keys() for row in comma] == [row.keys() for row in plain]
    dates = {"started"}
    for one, other in zip(plain, comma, strict=True):
        assert {name: value.replace(",", ".") for name, value in other.items()} == one
        assert {other[name] for name in dates} == {one[name] for name in dates}
        assert "," in other["path_error"] and "." not in other["path_error"]
    columns = (tmp_path / "b" / "P-7K3QX" / "columns.csv").read_text()
    assert columns.startswith("column;label;factor;unit;definition\n") and "1000,0" in columns


def test_a_byte_order_mark_is_put_in_front_when_asked_for(recorded, tmp_path):
    bag = recorded(MARCH, "2026-03-03T13:05:00+01:00", False)
    plain, marked = exported(bag, tmp_path / "a"), exported(bag, tmp_path / "b", "--bom")
    assert marked == b"\xef\xbb\xbf" + plain
    assert (tmp_path / "b" / "P-7K3QX" / "columns.csv").read_bytes().startswith(b"\xef\xbb\xbf")
