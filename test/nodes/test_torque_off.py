# SPDX-License-Identifier: Apache-2.0
"""`encoder/home` and `force_sensor/tare` act only while no drive gives torque."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from rclpy.node import Node
from screw_module_msgs.msg import AmplifierState, PlanarState
from services import activate, asked

from screw_module_ros.clock import ManualClock
from screw_module_ros.devices.errors import NotNow
from screw_module_ros.locks import lock_node
from screw_module_ros.nodes.support.driver import TorqueOff
from screw_module_ros.nodes.support.states import OK, Health

NAMESPACE = "/torque_off"  # no amplifier of another test has been discovered there
ON, OFF = AmplifierState(enabled=True), AmplifierState()
BY_ANOTHER = AmplifierState(state=AmplifierState.OPERATION_ENABLED)
MOVED = "the fault is cleared; this moves the origin by 57 mm"


class PatientClock(ManualClock):
    """Time goes on while somebody waits."""

    def wait_for(self, ready, timeout_s: float) -> bool:
        return any(ready() for _ in range(10))


def inbox_with(*amplifier: AmplifierState | None, plane=None) -> SimpleNamespace:
    """Return an inbox that gives these states, one for each look; the plane's at every look."""
    told = iter(amplifier)
    takes = {"screw/amplifier_state": lambda: next(told, None), "manus/state": lambda: plane}
    return SimpleNamespace(subscribe=lambda kind, topic, *_: takes[topic])


class StandsElsewhere:
    """An encoder with a latched fault that stands elsewhere than at its last home."""

    homed = True

    def __init__(self):
        self.fault, self.silent, self.asked = "somebody else sends SYNC", False, 0

    def clear_fault(self) -> None:
        self.fault, self.silent = "", False

    def home(self) -> float:
        self.asked += 1
        if self.asked == 1:
            raise NotNow("this moves the origin by 57 mm")
        return 0.25


@pytest.fixture
def made(make_node):
    """Return a maker of driver nodes with this device, whose loop serves each request at once."""

    def make(name: str, device: object):
        node = make_node(name, "-r", f"__ns:={NAMESPACE}")
        node.device, node.clock = device, PatientClock(1)
        node.port = SimpleNamespace(failed=False)
        node.requests.ask = lambda act: act()  # its loop is the test
        node.health = lambda: Health(OK, "", {})
        activate(node)
        return node

    return make


@pytest.fixture
def home(made):
    """Return what ~/home answers when the amplifier tells these states."""
    node = made("encoder", StandsElsewhere())

    def ask(*states: AmplifierState) -> str:
        node._torque_off = TorqueOff(node, inbox_with(None, *states), node.clock)
        return asked(node, "~/home").message

    ask.device = node.device
    return ask


@pytest.mark.parametrize("state", [ON, BY_ANOTHER])
def test_not_while_the_drive_is_enabled(home, state):
    """Whether by us or by somebody else; nothing is cleared then either."""
    said = home(state)
    assert "the vertical drive is enabled" in said and "disable it first" in said
    assert home() == MOVED


@pytest.mark.parametrize("states", [(), (OFF,)])
def test_while_disabled_or_silent_only_the_encoder_is_asked(home, states):
    assert home(*states) == MOVED
    assert home(*states) == "homed at 0.25 m"


def test_an_encoder_that_is_silent_without_a_fault_is_cleared_too(home):
    home.device.fault, home.device.silent = "", True
    assert home() == MOVED
    assert not home.device.silent


def test_an_amplifier_that_is_not_discovered_yet_is_not_a_silent_one(home):
    """It may be enabled; until the graph shows it nobody knows."""
    lock = lock_node(f"{NAMESPACE}/amplifier")
    try:
        said = home()
        assert "amplifier runs" in said and "try again in a moment" in said
        assert home.device.asked == 0 and home.device.fault, "nothing is cleared either"
        # Running and discovered, but not configured: it has no torque.
        node = Node("amplifier", namespace=NAMESPACE)
        try:
            assert home() == MOVED
        finally:
            node.destroy_node()
    finally:
        lock.release()


@pytest.mark.parametrize(
    ("before", "after", "plane", "told"),
    [
        (OFF, OFF, PlanarState(), ""),
        (ON, OFF, PlanarState(), "the vertical drive is enabled and would jump"),
        (OFF, ON, PlanarState(), "the vertical drive is enabled"),  # while samples were gathered
        (OFF, OFF, PlanarState(enabled=True), "the plane is enabled and would jump"),
        (OFF, OFF, PlanarState(drive_state=[0, AmplifierState.OPERATION_ENABLED]),
         "the plane is enabled and would jump"),
    ],
)  # fmt: skip
def test_no_tare_while_torque_passes_to_the_end(made, before, after, plane, told):
    """Force feedback would press with a multiple of what the tare removes."""
    tared = []
    device = SimpleNamespace(
        fault="", settings=SimpleNamespace(tare_samples=100),
        tare=lambda readings: tared.append(readings) or (0.0,) * 6,
    )  # fmt: skip
    node = made("force_sensor", device)
    inbox = inbox_with(None, before, None, after, plane=plane)
    topics = ("screw/amplifier_state", "manus/state")
    node._torque_off = TorqueOff(node, inbox, node.clock, topics)
    said = asked(node, "~/tare").message
    assert told in said
    assert bool(tared) is not bool(told)
