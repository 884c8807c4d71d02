# SPDX-License-Identifier: Apache-2.0
"""Two drives with one node id: both take each command, and nobody on a CAN bus refuses it."""

from __future__ import annotations

import pytest
from loop_parts import twin_of

from screw_module_ros.devices.errors import WrongDevice
from screw_module_ros.trials.one_thread import OneThreadRobot

STEADY = 100  # ticks


@pytest.fixture
def robot():
    made = OneThreadRobot()
    yield made
    made.close()


def test_two_drives_with_one_node_id_are_not_configured(robot):
    twin_of(robot)
    with pytest.raises(WrongDevice, match="more than one device answers as the drive .node id 1."):
        robot.drive.configure()
    assert not robot.drive.configured


def test_a_second_drive_with_our_id_stops_both_while_enabled(robot):
    """It has heard our configuration, and says nothing until then, as behind a bad cable."""
    twin = twin_of(robot)
    robot.rig.inject("twin", "mute", 0.0, 0.0, robot.now_ns)
    robot.ready()
    robot.controller.mode = 1
    assert robot.enable() == ""
    robot.ticks(20)
    assert twin.axis.driving, "it obeys, unseen"
    robot.rig.inject("twin", "clear", 0.0, 0.0, robot.now_ns)
    robot.ticks(STEADY)
    assert "more than one device answers as the drive (node id 1)" in robot.drive.fault
    assert "two statuswords per SYNC" in robot.drive.fault
    assert not (twin.axis.driving or robot.axis.permit.enabled)
    assert not robot.rig.devices["drive"].machine.driving


def test_a_second_drive_that_only_beats_stops_it_too(robot):
    twin_of(robot)
    robot.rig.inject("twin", "mute", 0.0, 0.0, robot.now_ns)
    robot.ready()
    robot.rig.inject("twin", "clear", 0.0, 0.0, robot.now_ns)
    robot.rig.inject("twin", "pdos_lost", 0.0, 0.0, robot.now_ns)
    robot.seconds(5.0)
    assert "two heartbeats a period" in robot.drive.fault


def test_a_robot_that_runs_for_long_has_no_twin(robot):
    robot.ready()
    robot.seconds(10.0)
    assert all(device.fault == "" for device in robot.devices)
