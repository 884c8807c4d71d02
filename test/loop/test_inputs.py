# SPDX-License-Identifier: Apache-2.0
"""How long a set point counts that nobody repeats."""

from __future__ import annotations

import math

import pytest

from screw_module_ros.control.modes import OFF
from screw_module_ros.loop.inputs import SetpointInput

NONE = math.nan, math.nan


@pytest.mark.parametrize(
    ("age_ns", "acts", "position", "velocity"),
    [
        (200_000_000, True, (0.1, -0.2), (0.3, 0.4)),
        (200_000_001, True, (0.1, -0.2), (0.0, 0.0)),
        (1_000_000_000, False, (0.1, -0.2), (0.0, 0.0)),
        (1_000_000_001, False, NONE, (0.0, 0.0)),
        (100_000_000_000, True, (0.1, -0.2), (0.0, 0.0)),
    ],
)
def test_what_is_left_of_a_set_point(age_ns, acts, position, velocity):
    given, wanted = SetpointInput(axes=2), (*position, *velocity)
    assert given.at(1, True) == pytest.approx((*NONE, 0.0, 0.0), nan_ok=True)
    given.ask((0.1, -0.2), (0.3, 0.4), 1)
    assert given.at(1 + age_ns, acts) == pytest.approx(wanted, nan_ok=True)
    # What was forgotten does not come back with the torque.
    assert given.at(1 + age_ns, True) == pytest.approx(wanted, nan_ok=True)


@pytest.mark.parametrize("pause_s", [0.2, 1.1])
@pytest.mark.parametrize("disabled", [False, True])
def test_it_does_not_pull_to_where_a_game_was(enabled, disabled, pause_s, monkeypatch):
    """Its page was closed; the patient was strapped in again somewhere else."""
    controller, mode = enabled.controller, enabled.controller.mode
    controller.wanted.ask((enabled.home + 0.1,), (0.0,), enabled.now_ns)
    monkeypatch.setattr(controller.wanted, "ask", lambda *_: None)
    enabled.seconds(0.1)
    if disabled:
        assert enabled.disable() == ""
    else:
        controller.mode = OFF
    enabled.seconds(pause_s)
    controller.mode = mode
    assert enabled.enable() == ""
    enabled.seconds(0.8)
    is_at_it = abs(controller.output.desired_position - enabled.home - 0.1) < 0.01
    assert is_at_it == (pause_s < 1.0)
