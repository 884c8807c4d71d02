# SPDX-License-Identifier: Apache-2.0
"""The commands of therapy sessions beside a running robot; with a real bag see test/nodes."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import pytest

from screw_module_ros.recording.pseudonym import checked_pseudonym
from screw_module_ros.session_command import main
from screw_module_ros.therapy import cli
from screw_module_ros.therapy.hand import HandSample
from screw_module_ros.therapy.recorded import Recorded, in_order


def test_new_prints_a_pseudonym(capsys):
    assert main(["new"]) == 0
    assert checked_pseudonym(capsys.readouterr().out.strip())


@pytest.mark.parametrize(
    "command", [["verify"], ["replay"], ["report", "--out"], ["export", "--out"]]
)
def test_a_folder_that_is_no_bag_is_said_so(command, tmp_path, capsys):
    extra = [str(tmp_path / "out")] if "--out" in command else []
    assert main([*command, *extra, str(tmp_path / "nothing")]) == 1
    assert capsys.readouterr().err == f"session: there is no bag {tmp_path / 'nothing'}\n"
    assert not (tmp_path / "out").exists(), "nothing is made of nothing"


def test_reports_need_a_place(tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["report", str(tmp_path)])
    assert ended.value.code == 2
    assert "--out" in capsys.readouterr().err


S = 1_000_000_000


def session(folder, begun_s, has_trials=True):
    """Return a session whose first trial, or first sample, has this stamp [s]."""
    trials = [{"started_ns": round(begun_s * S)}] if has_trials else []
    samples = [HandSample(1, 0, *(0.0,) * 9, stamp_ns=round(begun_s * S))]
    return Recorded(Path(folder), "P-7K3QX", None, [], trials, [], samples)


def names(*sessions):
    return [each.folder.name for each in in_order(sessions)]


def test_simulated_sessions_stand_by_date_though_their_time_begins_anew():
    first = session("P-7K3QX_elevator_2026_03_01-10_00_00", 900.0)
    second = session("P-7K3QX_clock_adaptive_2026_03_02-10_00_00", 12.0)
    third = session("P-7K3QX_clock_adaptive_2026_03_02-11_00_00", 5.0, has_trials=False)
    expected = names(first, second, third)
    assert expected == [each.folder.name for each in (first, second, third)]
    assert names(third, second, first) == expected


def test_simulated_and_real_sessions_stand_together():
    at = datetime(2026, 3, 1, 12).timestamp()
    real, later = session("real", at), session("x_2026_03_01-12_00_01", 3.0)
    assert names(later, real) == ["real", later.folder.name]


@pytest.mark.parametrize("name", ["renamed", "x_2026_99_01-12_00_00"])
def test_without_a_date_the_given_order_stays(name):
    renamed = session(name, 900.0)
    assert names(renamed, session("x_2026_03_01-12_00_01", 3.0))[0] == name
    assert names(session("x_2026_03_01-12_00_01", 3.0), renamed)[1] == name


def test_a_real_session_without_a_trial_is_not_the_first():
    early, late = session("early", 1.7e9), session("late", 1.8e9, has_trials=False)
    assert names(late, early) == ["early", "late"]


def test_a_copy_of_a_bag_is_no_second_session(monkeypatch, capsys):
    one, other = "P-7K3QX_elevator_2026_03_01-10_00_00", "P-7K3QX_elevator_2026_03_02-10_00_00"
    stamps = {one: 900.0, f"backup/{one}": 900.0, other: 900.0, "real": 1.7e9, "renamed": 1.7e9}
    monkeypatch.setattr(cli, "_read", lambda bag: [session(bag, stamps[str(bag)])])
    found = cli._in_order([Path(name) for name in stamps])
    assert {str(each.folder) for each in found} == {one, other, "real"}
    told = capsys.readouterr().err.splitlines()
    assert told == [
        f"NOTE backup/{one} is a copy of {one}: left out",
        "NOTE renamed is a copy of real: left out",
    ]
