# SPDX-License-Identifier: Apache-2.0
"""Numbers on the command line are finite."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from screw_module_ros.trials import soak
from screw_module_ros.trials.benchmark import command as bench


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
