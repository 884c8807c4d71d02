# SPDX-License-Identifier: Apache-2.0
"""A sensor's latched fault is on /diagnostics at once, not with the next entry of each second."""

from types import SimpleNamespace

import pytest

from screw_module_ros.nodes.support.states import OK, WARN, Health


@pytest.mark.parametrize("name", ["encoder", "force_sensor"])
def test_a_fault_and_its_end_are_reported_at_once(make_node, name):
    node, entries, said = make_node(name), [], []
    node._diagnostics = SimpleNamespace(publish=entries.append)
    node.device = SimpleNamespace(fault="")
    node._active.set()
    node.health = lambda: Health(OK, node.device.fault, {})
    for text in ("", "status bit 4", "status bit 4", "status bit 6", ""):
        assert node.enters()
        node.device.fault = text
        node.leaves()
        said.append([status.message for entry in entries for status in entry.status])
        entries.clear()
    assert said == [[], ["status bit 4"], [], ["status bit 6"], [""]]
    node._active.clear()


@pytest.mark.parametrize("name", ["encoder", "force_sensor"])
def test_slow_values_are_read_each_five_seconds_while_the_node_is_active(make_node, name):
    node, read = make_node(name), []
    poll = [timer for timer in node.periodic._all if timer.call == node._poll_slow]
    assert [timer.period_ns for timer in poll] == [5_000_000_000]
    poll[0].run()
    node.device = SimpleNamespace(fault="", poll_slow=lambda: read.append(True))
    poll[0].run()
    assert not read
    node._active.set()
    poll[0].run()
    assert read
    node._active.clear()


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
