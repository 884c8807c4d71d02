# SPDX-License-Identifier: Apache-2.0
"""How long a set point counts that nobody repeats."""

from __future__ import annotations

import math

import pytest

from screw_module_ros.loop.inputs import KEPT_NS, MOVING_NS, SetpointInput


@pytest.mark.parametrize(
    ("age_ns", "acts", "wanted"),
    [
        (MOVING_NS, True, (0.3, 0.1)),
        (MOVING_NS + 1, True, (0.3, 0.0)),
        (KEPT_NS, False, (0.3, 0.0)),
        (KEPT_NS + 1, False, (math.nan, 0.0)),
        (100 * KEPT_NS, True, (0.3, 0.0)),
    ],
)
def test_what_is_left_of_a_set_point(age_ns, acts, wanted):
    given = SetpointInput(axes=1)
    given.ask((0.3,), (0.1,), 1)
    assert given.at(1 + age_ns, acts) == pytest.approx(wanted, nan_ok=True)
    if not acts:  # what was forgotten does not come back with the torque
        assert given.at(1 + age_ns, True) == pytest.approx(wanted, nan_ok=True)


@pytest.mark.parametrize("pause_s", [0.2, 1.5])
def test_enabled_again_it_does_not_pull_to_where_a_game_was(enabled, pause_s, monkeypatch):
    """Its page was closed while the patient was strapped in again, the arm somewhere else."""
    wanted = enabled.controller.wanted
    wanted.ask((enabled.home + 0.1,), (0.0,), enabled.now_ns)
    monkeypatch.setattr(wanted, "ask", lambda *_: None)
    enabled.seconds(0.1)
    assert enabled.disable() == ""
    enabled.seconds(pause_s)
    assert enabled.enable() == ""
    enabled.seconds(1.0)
    is_at_it = abs(enabled.controller.output.desired_position - enabled.home - 0.1) < 0.01
    assert is_at_it == (pause_s < 1.0)
