# SPDX-License-Identifier: Apache-2.0
"""`encoder/home` moves the origin only while the vertical drive gives no torque."""

from __future__ import annotations

import pytest
from amplifier_told import PatientClock, inbox_with, served_at_once
from rclpy.node import Node
from screw_module_msgs.msg import AmplifierState

from screw_module_ros.devices.errors import NotNow
from screw_module_ros.nodes.support.answering import carried_out
from screw_module_ros.nodes.support.driver import TorqueOff
from screw_module_ros.nodes.support.place import lock_node

NAMESPACE = "/homing_permitted"  # no amplifier of another test has been discovered there


class Device:
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
def home(make_node):
    """Return what the service answers when the amplifier tells these states."""
    node = make_node("encoder", "-r", f"__ns:={NAMESPACE}")
    device = node.device = Device()
    node.part = served_at_once()

    def ask(*states: AmplifierState) -> str:
        node._torque_off = TorqueOff(node, inbox_with(None, *states), PatientClock(1))
        return carried_out(node, node._home, None, "~/home", always=True)

    ask.device = device
    return ask


@pytest.mark.parametrize(
    "state",
    [AmplifierState(enabled=True), AmplifierState(state=AmplifierState.OPERATION_ENABLED)],
)
def test_not_while_the_drive_is_enabled(home, state):
    """Whether by us or by somebody else; nothing is cleared then either."""
    said = home(state)
    assert "the vertical drive is enabled" in said and "disable it first" in said
    assert home() == "the fault is cleared; this moves the origin by 57 mm"


@pytest.mark.parametrize("states", [(), (AmplifierState(),)])
def test_while_disabled_or_silent_only_the_encoder_is_asked(home, states):
    said = home(*states)
    assert said == "the fault is cleared; this moves the origin by 57 mm"
    assert home(*states) == "homed at 0.25 m"


def test_an_encoder_that_is_silent_without_a_fault_is_cleared_too(home):
    home.device.fault, home.device.silent = "", True
    assert home() == "the fault is cleared; this moves the origin by 57 mm"
    assert not home.device.silent


def test_the_check_raises_what_a_service_answers_with():
    inbox = inbox_with(None, AmplifierState(enabled=True))
    torque_off = TorqueOff(None, inbox, PatientClock(1))
    with pytest.raises(NotNow, match="enabled and would jump"):
        torque_off.check("would jump")


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
            assert home() == "the fault is cleared; this moves the origin by 57 mm"
        finally:
            node.destroy_node()
    finally:
        lock.release()
