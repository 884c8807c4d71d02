# SPDX-License-Identifier: Apache-2.0
"""Checked before the work: numbers are finite, files can be written."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from screw_module_ros.identification.speed import Speed
from screw_module_ros.trials import soak
from screw_module_ros.trials.benchmark import command as bench
from screw_module_ros.trials.faults import command as faults


@pytest.mark.parametrize(
    ("command", "option"),
    [(soak, "--minutes"), (soak, "--every"), (soak, "--change"), (bench, "--seconds")],
)
@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1e400"])
def test_what_is_no_finite_number_is_refused_by_name(command, option, value, monkeypatch):
    monkeypatch.setattr(command.command, "callback", lambda **given: pytest.fail(f"{given}"))
    result = CliRunner().invoke(command.command, [option, value])
    assert result.exit_code == 2
    assert option in result.output


def test_a_number_in_its_range_is_taken(monkeypatch):
    taken = []
    monkeypatch.setattr(soak.command, "callback", lambda **given: taken.append(given["minutes"]))
    assert CliRunner().invoke(soak.command, ["--minutes", "2.5"]).exit_code == 0
    assert taken == [2.5]


@pytest.mark.parametrize("command", [bench, faults])
def test_a_file_that_cannot_be_written_is_refused_before_the_work(command, tmp_path, monkeypatch):
    """Else the figures of many minutes would be lost at the end."""
    monkeypatch.setattr(command.command, "callback", lambda **given: pytest.fail(f"{given}"))
    for file in (tmp_path / "none" / "x.json", tmp_path):
        result = CliRunner().invoke(command.command, ["--json", str(file)])
        assert result.exit_code == 2
        assert "--json" in result.output and str(file) in result.output


@pytest.mark.parametrize("command", [bench, faults])
def test_a_file_that_can_be_written_is_taken(command, tmp_path, monkeypatch):
    taken = []
    monkeypatch.setattr(command.command, "callback", lambda **given: taken.append(given))
    monkeypatch.chdir(tmp_path)
    for file in ("x.json", str(tmp_path / "y.json")):
        assert CliRunner().invoke(command.command, ["--json", file]).exit_code == 0
    assert len(taken) == 2 and not list(tmp_path.iterdir())


def test_a_full_disk_does_not_take_the_figures_with_it(monkeypatch, tmp_path):
    def full(*_: object) -> None:
        raise OSError("the disk is full")

    monkeypatch.setattr(bench, "measure_loop", lambda runs, console: [Speed("one", 1, (321.0,))])
    monkeypatch.setattr(bench, "write", full)
    given = ["--only", bench.LOOP, "--json", str(tmp_path / "x.json")]
    result = CliRunner().invoke(bench.command, given)
    assert result.exit_code == 1
    assert "321" in result.output and "the disk is full" in result.output
