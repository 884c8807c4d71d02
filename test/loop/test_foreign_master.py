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
from screw_module_ros.trials.one_thread import OneThreadRobot

LIMIT = largest_command(TorqueChain(linearization=default_linearization()))
"""What `amplifier` tells the drive as its own limit [Nm]."""
QUIET = 1e-3


class Intruder:
    """A foreign master on the vertical drive's bus."""

    def __init__(self, robot):
        self._robot = robot
        self.bus = robot.buses["drive"].join()

    def _send(self, can_id, data):
        self.bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))
        self._robot.rig.process(self._robot.now_ns)

    def command(self, controlword, per_mille):
        self._send(0x201, struct.pack("<Hh", controlword, per_mille))

    def write(self, index, value):
        """Download an object of two bytes by SDO, expedited (CiA 301, 7.2.4.3.3)."""
        self._send(0x601, struct.pack("<BHBi", 0x2B, index, 0, value))


@pytest.fixture
def robot():
    made = OneThreadRobot(drive=DriveSettings(max_torque=LIMIT))
    made.ready()
    yield made
    made.close()


@pytest.fixture
def intruder(robot):
    made = Intruder(robot)
    with made.bus:
        yield made


WALK_UP = (0x06, 0x07, 0x0F)


def torques(robot, intrude, ticks):
    """What the rig's motor gives [Nm] in each tick, in the midst of which somebody intrudes."""
    seen = []
    for _ in range(ticks):
        intrude()
        robot.rig.process(robot.now_ns)
        robot.tick()
        seen.append(abs(robot.world.vertical_torque))
    return seen


@pytest.mark.parametrize(
    ("by_sdo", "said"), [(False, "somebody else commands"), (True, "another SDO client")]
)
def test_a_walk_up_that_nobody_asked_for_ends_at_once(robot, intruder, by_sdo, said):
    def walk_up():
        if by_sdo:
            intruder.write(0x6071, 1000)
        for word in WALK_UP:
            intruder.write(0x6040, word) if by_sdo else intruder.command(word, 1000)

    seen = torques(robot, walk_up, 300)
    assert said in robot.drive.fault
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
    assert not robot.axis.permit.enabled and robot.drive.fault


def test_the_rig_s_drive_obeys_its_limit(robot, intruder):
    """Also where nobody stops the intruder: our own program does not run."""
    for word in WALK_UP:
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
        intruder.write(0x6072, 10_000)
        intruder.write(0x6007, 0)
        intruder.write(0x6071, 1000)

    seen = torques(robot, unguard, 1) + torques(robot, lambda: None, 100)
    assert max(seen[5:]) < QUIET and not robot.axis.permit.enabled
    assert "another SDO client" in robot.drive.fault
    assert robot.clear_fault() == ""
    robot.ticks(10)
    assert robot.drive.sdo.unsigned(0x6072) == limit
    assert robot.drive.sdo.unsigned(0x6007) == 1
    assert robot.enable() == ""
