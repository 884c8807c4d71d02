# SPDX-License-Identifier: Apache-2.0
"""Where each simulated patient moves the hand in a trial."""

from __future__ import annotations

import pytest
from geometry_msgs.msg import Point
from screw_module_msgs.msg import EndpointSetpoint, TherapyState

from screw_module_ros.clock import ManualClock
from screw_module_ros.trials.simulated_player import HEALTHY, PEOPLE, WEAK, SimulatedPlayer

START, TARGET = (0.0, 0.0, 0.18), (0.1, -0.05, 0.18)


class PlayedRobot:
    """Takes the place of `Robot`: notes where the arm is sent; `hear` plays a message to it."""

    def __init__(self):
        self.sent, self.node, self._heard = [], self, {}
        self.clock = ManualClock(1_000_000_000)

    def create_subscription(self, kind, name, heard, depth):
        self._heard[kind] = heard

    def hear(self, message):
        self._heard[type(message)](message)

    def send_arm(self, arm):
        self.sent.append((arm.target.x, arm.target.y, arm.target.z))


@pytest.fixture
def trial():
    return TherapyState(
        state=TherapyState.RUNNING, kind="reach", trial=1,
        start=Point(x=START[0], y=START[1], z=START[2]),
        target=Point(x=TARGET[0], y=TARGET[1], z=TARGET[2]),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("patient", "reached"), [(HEALTHY, TARGET), (WEAK, (0.08, -0.04, 0.18))]
)
def test_a_weak_patient_comes_four_fifths_of_the_way(trial, patient, reached):
    robot = PlayedRobot()
    player = SimulatedPlayer(robot, PEOPLE[patient])
    for phase in (TherapyState.PREPARE, TherapyState.MOVING, TherapyState.OVER_TIME):
        trial.phase = phase
        robot.hear(trial)
        player.look()
    assert robot.sent == [pytest.approx(START), pytest.approx(reached)]


def test_a_game_s_wish_is_followed_as_far_as_the_robot_goes_until_the_game_is_silent():
    """A hand that went for a point five metres away pulled with 152 N once nobody wished it."""
    robot = PlayedRobot()
    player = SimulatedPlayer(robot, PEOPLE[HEALTHY])
    robot.hear(EndpointSetpoint(position=Point(x=5.0, y=-5.0, z=5.0)))
    player.look()
    assert robot.sent == [pytest.approx((0.15, -0.15, 0.33))]
    robot.hear(EndpointSetpoint(position=Point(x=0.0, y=0.0, z=0.2)))
    robot.clock.time_ns += 1_000_000_001
    player.look()
    assert len(robot.sent) == 1, "the game has gone"
