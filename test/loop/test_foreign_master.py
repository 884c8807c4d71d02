# SPDX-License-Identifier: Apache-2.0
"""A second master on the drive's bus: what it makes of the motor, and for how long."""

from __future__ import annotations

import random
import struct

import can
import pytest

from screw_module_ros.control.linearization import default_linearization
from screw_module_ros.control.torque_chain import TorqueChain, largest_command
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.trials.one_thread import Bench

LIMIT = largest_command(
    TorqueChain(linearization=default_linearization())
)
"""What `amplifier` tells the drive as its own limit [Nm]."""
QUIET = 1e-3


class Intruder:
    """A foreign master on the vertical drive's bus."""

    def __init__(self, robot):
        channel = robot.ports["drive"].bus.channel_id
        self._bus = can.Bus(interface="virtual", channel=channel)
        self._robot = robot

    def command(self, controlword, per_mille):
        data = struct.pack("<Hh", controlword, per_mille)
        self._bus.send(can.Message(arbitration_id=0x201, data=data, is_extended_id=False))
        self._robot.rig.process(self._robot.now_ns)

    def write(self, index, value, size):
        """Download an object by SDO, expedited (CiA 301, 7.2.4.3.3)."""
        code = {1: 0x2F, 2: 0x2B, 4: 0x23}[size]
        data = struct.pack("<BHBi", code, index, 0, value)
        self._bus.send(can.Message(arbitration_id=0x601, data=data, is_extended_id=False))
        self._robot.rig.process(self._robot.now_ns)

    def close(self):
        self._bus.shutdown()


@pytest.fixture
def robot():
    made = Bench(drive=DriveSettings(max_torque=LIMIT))
    made.ready()
    yield made
    made.close()


@pytest.fixture
def intruder(robot):
    made = Intruder(robot)
    yield made
    made.close()


def torques(robot, intrude, ticks):
    """What the rig's motor gives [Nm] in each tick, in the midst of which somebody intrudes."""
    seen = []
    for _ in range(ticks):
        intrude()
        robot.rig.process(robot.now_ns)
        robot.tick()
        seen.append(abs(robot.world.vertical_torque))
    return seen


def test_a_walk_up_that_nobody_asked_for_ends_at_once(robot, intruder):
    def walk_up():
        for word in (0x06, 0x07, 0x0F):
            intruder.command(word, 1000)

    seen = torques(robot, walk_up, 300)
    assert "somebody else commands" in robot.drive.fault
    assert max(seen) <= LIMIT + QUIET
    assert max(seen[5:]) < QUIET


@pytest.mark.parametrize("seed", range(3))
def test_random_commands_stop_an_enabled_drive_below_its_own_limit(robot, intruder, seed):
    """They made -519 N before the stop."""
    robot.controller.mode = 1
    assert robot.enable() == ""
    robot.ticks(600)
    chance = random.Random(seed)

    def anything():
        for _ in range(10):
            intruder.command(chance.getrandbits(16), chance.randint(-32768, 32767))

    seen = torques(robot, anything, 150)
    assert max(seen) <= LIMIT + QUIET
    assert max(seen[10:]) < QUIET
    assert not robot.torque_passes and robot.drive.fault


def test_the_rig_s_drive_obeys_its_limit(robot, intruder):
    """Also where nobody stops the intruder: our own program does not run."""
    for word in (0x06, 0x07, 0x0F):
        intruder.command(word, 32767)
    seen = []
    for _ in range(15):
        robot.clock.time_ns += 1_000_000
        robot.rig.process(robot.now_ns)
        seen.append(abs(robot.world.vertical_torque))
    assert LIMIT - 0.03 < max(seen) <= LIMIT + QUIET


@pytest.mark.parametrize("enabled", [True, False])
def test_a_foreign_sdo_client_stops_the_drive_and_what_it_altered_is_set_anew(
    robot, intruder, enabled
):
    """Its guards were read back when it was configured, and never again."""
    robot.controller.mode = 1
    if enabled:
        assert robot.enable() == ""
        robot.ticks(600)
    limit = robot.drive.sdo.unsigned(0x6072)

    def unguard():
        intruder.write(0x6072, 10_000, 2)
        intruder.write(0x6007, 0, 2)
        intruder.write(0x6071, 1000, 2)

    seen = torques(robot, unguard, 1) + torques(robot, lambda: None, 100)
    assert max(seen[5:]) < QUIET and not robot.torque_passes
    assert "another SDO client" in robot.drive.fault
    assert robot.clear_fault() == ""
    robot.ticks(10)
    assert robot.drive.sdo.unsigned(0x6072) == limit
    assert robot.drive.sdo.unsigned(0x6007) == 1
    assert robot.enable() == ""


def test_a_walk_up_by_sdo_ends_as_well(robot, intruder):
    def walk_up():
        intruder.write(0x6071, 1000, 2)
        for word in (0x06, 0x07, 0x0F):
            intruder.write(0x6040, word, 2)

    seen = torques(robot, walk_up, 300)
    assert "another SDO client" in robot.drive.fault
    assert max(seen) <= LIMIT + QUIET
    assert max(seen[5:]) < QUIET
