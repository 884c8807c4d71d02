# SPDX-License-Identifier: Apache-2.0
"""`force_sensor/tare` moves the zero only while no drive gives torque, to the end.

It gathers samples for a tenth of a second or more, and an operator may enable meanwhile.
"""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from amplifier_told import PatientClock, each_state_again, inbox_with, served_at_once
from screw_module_msgs.msg import AmplifierState, PlanarState

from screw_module_ros.nodes.support.answering import carried_out
from screw_module_ros.nodes.support.driver import TorqueOff


class Device:
    """A force sensor; tared: how often."""

    fault = ""
    settings = SimpleNamespace(tare_samples=100)

    def __init__(self):
        self.tared = 0

    def tare(self, readings) -> tuple:
        self.tared += 1
        return (0.0,) * 6


@pytest.mark.parametrize(
    ("before", "after", "tared"), [(False, False, 1), (True, False, 0), (False, True, 0)]
)
def test_not_while_the_drive_is_enabled_nor_when_it_was_meanwhile(make_node, before, after, tared):
    node = make_node("force_sensor")
    node.device = Device()
    node.part = served_at_once()
    states = (None, AmplifierState(enabled=before), None, AmplifierState(enabled=after))
    node.clock = PatientClock(1)
    node._torque_off = TorqueOff(node, inbox_with(*states), node.clock)
    said = carried_out(node, node._tare, None, "~/tare", always=True)
    assert node.device.tared == tared
    assert ("the vertical drive is enabled" in said) is not bool(tared)


@pytest.mark.parametrize(
    ("plane", "tared"),
    [
        (PlanarState(), 1),
        (PlanarState(enabled=True), 0),
        (PlanarState(drive_state=[0, AmplifierState.OPERATION_ENABLED]), 0),
    ],
)
def test_not_while_the_plane_is_enabled(make_node, plane, tared):
    """Its force feedback would press with a multiple of what the tare removes."""
    node = make_node("force_sensor")
    node.device = Device()
    node.part = served_at_once()
    node.clock = PatientClock(1)
    inboxes = {"screw/amplifier_state": AmplifierState(), "manus/state": plane}
    node._torque_off = TorqueOff(node, each_state_again(inboxes), node.clock, tuple(inboxes))
    said = carried_out(node, node._tare, None, "~/tare", always=True)
    assert node.device.tared == tared
    assert ("the plane is enabled and would jump" in said) is not bool(tared)
