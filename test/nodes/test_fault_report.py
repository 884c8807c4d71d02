# SPDX-License-Identifier: Apache-2.0
"""A sensor's latched fault is on /diagnostics at once, not with the next entry of each second."""

import math
from collections import Counter
from types import SimpleNamespace

import pytest
from screw_module_msgs.msg import PlanarState
from services import activate

from screw_module_ros.nodes.support.states import ERROR, OK, WARN, Health
from screw_module_ros.samples import ForceReading


@pytest.mark.parametrize("name", ["encoder", "force_sensor"])
def test_a_fault_and_its_end_are_reported_at_once(make_node, name):
    node, entries, said = make_node(name), [], []
    node.device = SimpleNamespace(fault="")
    activate(node)
    node.publish_health = lambda: entries.append(node.alarm)
    for text in ("", "status bit 4", "status bit 4", "status bit 6", ""):
        assert node.enters()
        node.device.fault = text
        node.leaves()
        said.append(list(entries))
        entries.clear()
    assert said == [[], ["status bit 4"], [], ["status bit 6"], [""]]


@pytest.mark.parametrize("name", ["encoder", "force_sensor"])
def test_slow_values_are_read_each_five_seconds_while_the_node_is_active(
    make_node, monkeypatch, name
):
    node, read = make_node(name), []
    node.health = lambda: Health(OK, "", {})
    begin_ns = node.clock.now_ns()

    def calls_until(seconds):
        monkeypatch.setattr(node.clock, "now_ns", lambda: begin_ns + round(seconds * 1e9))
        node.periodic.run()
        return len(read)

    assert calls_until(5.0) == 0, "it has no device yet"
    node.device = SimpleNamespace(fault="", poll_slow=lambda: read.append(True))
    assert calls_until(10.0) == 0
    activate(node)
    assert [calls_until(seconds) for seconds in (12.0, 15.0, 17.0, 20.0)] == [0, 1, 1, 2]


def test_a_driver_whose_slow_values_fail_does_not_end_the_node(make_node, monkeypatch):
    def fails():
        raise OSError("no route to the sensor")

    node = make_node("force_sensor")
    node.device = SimpleNamespace(fault="", poll_slow=fails, counters=Counter())
    node.health = lambda: Health(OK, "", {})
    activate(node)
    begin_ns = node.clock.now_ns()
    monkeypatch.setattr(node.clock, "now_ns", lambda: begin_ns + 6_000_000_000)
    node.periodic.run()
    assert node.device.counters == {"slow_polls_failed": 1}


@pytest.mark.parametrize(
    ("bias", "tared", "level"),
    [(0.0, False, WARN), (9.8, True, OK), (9.8, False, WARN)],
)
def test_a_sensor_that_was_not_tared_says_so(make_node, monkeypatch, bias, tared, level):
    """With force feedback the handle's weight would press on the hand, several times over."""
    node = make_node("force_sensor")
    node.device = SimpleNamespace(bias=(0.0, 0.0, bias, 0.0, 0.0, 0.0), tared=tared, shown={})
    monkeypatch.setattr(node, "sensor_health", lambda shown: Health(OK, "sampling", shown))
    health = node.health()
    assert health.level == level
    assert ("~/tare" in health.message) == (level == WARN)


def test_a_drifted_zero_is_shown_once_nobody_holds_the_handle(make_node, monkeypatch):
    """It is shown alone: what removes it is a tare."""
    node = make_node("force_sensor")
    node.device = SimpleNamespace(bias=(0.0,) * 6, tared=True, shown={})
    node._wrench_every, node._watched = 5, 200
    node._send_wrench = node.publish_packed = lambda *each: None
    monkeypatch.setattr(node, "sensor_health", lambda shown: Health(OK, "sampling", shown))

    def shown(force) -> str:
        for k in range(1000):
            node.publish(ForceReading(k, 0, 0, 0.0, 0.0, force(k), 0.0, 0.0, 0.0, 0))
        return node.health().values["error of the zero, if nothing hangs on the handle"]

    assert shown(lambda k: 3.0 * math.sin(0.005 * k)) == "somebody may hold the handle"
    assert shown(lambda k: -0.8) == "0.00, 0.00, -0.80 N"


@pytest.mark.parametrize(
    ("level", "share", "shown"), [(OK, 1.0, OK), (OK, 0.4, WARN), (ERROR, 0.4, ERROR)]
)
def test_the_plane_says_what_its_guard_leaves(make_node, monkeypatch, level, share, shown):
    node = make_node("manus")
    drive = SimpleNamespace(state=lambda now_ns: SimpleNamespace(text="on"), counters={})
    node.state, node._latency_p99, node.drives = PlanarState(), 0.0, (drive, drive)
    motors = [SimpleNamespace(warmth=warmth) for warmth in (0.1, 0.97)]
    node._plane = SimpleNamespace(
        controller=SimpleNamespace(homed=True, share=share), drives=SimpleNamespace(motors=motors),
        skipped=0,
    )  # fmt: skip
    node._slot = SimpleNamespace(refused="")
    node._pullers = SimpleNamespace(warning="")
    monkeypatch.setattr(node, "port_values", lambda skipped: {})
    monkeypatch.setattr(node, "drive_health", lambda values, state: Health(level, "", values))
    health = node.health()
    assert health.level == shown
    assert ("40 % of feedback" in health.message) == (shown == WARN)
    assert health.values["force gain [%]"] == f"{100.0 * share:.0f}"
    assert (health.values["shoulder heat [%]"], health.values["elbow heat [%]"]) == ("10", "97")
