# SPDX-License-Identifier: Apache-2.0
"""A second master on the drive's bus: what it makes of the motor, and for how long."""

from __future__ import annotations

import struct

import can
import pytest

TORQUE_LIMIT = 0.32
"""Of the commands that 95 N take, dead zone included [Nm]."""


class Intruder:
    """A foreign master on the vertical drive's bus."""

    def __init__(self, bench):
        self._channel = bench.ports["drive"].bus.channel_id
        self._bus = can.Bus(interface="virtual", channel=self._channel)
        self._bench = bench

    def send(self, can_id, data):
        self._bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))
        self._bench.rig.process(self._bench.now_ns)

    def walk_up(self, per_mille):
        for word in (0x06, 0x07, 0x0F):
            self.send(0x201, struct.pack("<Hh", word, per_mille))

    def close(self):
        self._bus.shutdown()


@pytest.fixture
def intruder(bench):
    made = Intruder(bench)
    yield made
    made.close()


def motor_torque(bench):
    """What the rig's motor gives [Nm]."""
    return bench.world.vertical_torque


def test_a_walk_up_that_nobody_asked_for_ends_at_once(bench, intruder):
    seen = []
    for _ in range(3000):
        intruder.walk_up(1000)
        bench.tick()
        seen.append(abs(motor_torque(bench)))
    assert "somebody else commands" in bench.drive.fault
    assert max(seen[5:]) < 1e-3, [(k, s) for k, s in enumerate(seen) if s > 1e-3][:20]
    assert max(seen) < TORQUE_LIMIT * 4
