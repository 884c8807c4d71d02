# SPDX-License-Identifier: Apache-2.0
"""A sensor's latched fault is on /diagnostics at once, not with the next entry of each second."""

from types import SimpleNamespace

import pytest

from screw_module_ros.clock import ManualClock
from screw_module_ros.nodes.support.states import OK, WARN, Health
from screw_module_ros.nodes.support.timers import Timers

S = 1_000_000_000


@pytest.mark.parametrize("name", ["encoder", "force_sensor"])
def test_a_fault_and_its_end_are_reported_at_once(make_node, name):
    node, fault, entries = make_node(name), [""], []
    node.clock, node.periodic = ManualClock(S), Timers()
    node._diagnostics = SimpleNamespace(publish=entries.append)
    node.start_polls(lambda: fault[0])
    said = []
    for text in ("", "status bit 4", "status bit 4", "status bit 6", ""):
        fault[0] = text
        if node.periodic.is_due():  # then the loop wakes the thread that publishes
            node.periodic.run()
        said.append(len(entries))
    assert said == [0, 1, 1, 2, 3]
    node.stop_polls()
    fault[0] = "late"
    node.periodic.run()
    assert len(entries) == 3


@pytest.mark.parametrize(
    ("bias", "tared", "level"),
    [(0.0, False, WARN), (9.8, True, OK), (9.8, False, WARN)],
)
def test_a_sensor_that_was_not_tared_says_so(make_node, monkeypatch, bias, tared, level):
    """With force feedback the handle's weight would press on the hand, several times over."""
    node = make_node("force_sensor")
    node.device = SimpleNamespace(bias=(0.0, 0.0, bias, 0.0, 0.0, 0.0), tared=tared, voltages={})
    monkeypatch.setattr(node, "sensor_health", lambda shown: Health(OK, "sampling", shown))
    health = node.health()
    assert health.level == level
    assert ("~/tare" in health.message) == (level == WARN)
