# SPDX-License-Identifier: Apache-2.0
"""The simulated patient: hand, reach, and where each person moves the hand in a trial."""

from __future__ import annotations

import math

import pytest
from click.testing import CliRunner
from geometry_msgs.msg import Point
from screw_module_msgs.msg import EndpointSetpoint, TherapyState

from screw_module_ros.clock import ManualClock
from screw_module_ros.plant.patient import arm_force, with_traits
from screw_module_ros.plant.settings import load_world
from screw_module_ros.trials import therapy
from screw_module_ros.trials.patient import (
    FLACCID,
    HEALTHY,
    PEOPLE,
    RADIUS,
    WEAK,
    Hand,
    SimulatedPlayer,
    Way,
    centre_out,
    targets,
)

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


def test_a_flaccid_patient_hangs_his_arm_on_the_handle_and_never_moves_it(trial):
    flaccid = PEOPLE[FLACCID]
    takes = flaccid.takes_hold()
    assert dict(zip(takes.traits, takes.values, strict=True)) == {"weight": 20.0, "carried": 0.0}
    robot = PlayedRobot()
    player = SimulatedPlayer(robot, flaccid)
    for phase in (TherapyState.PREPARE, TherapyState.MOVING):
        trial.phase = phase
        robot.hear(trial)
        player.look()
    assert robot.sent == []


@pytest.mark.parametrize(("patient", "traits", "weight"), [
    (HEALTHY, [], 0.0),
    (WEAK, [("weight", 15.0), ("carried", 0.5)], 7.5),
    (FLACCID, [("weight", 9.0)], 9.0),
    (FLACCID, [("carried", 0.5), ("carried", 1.0)], 0.0),
])  # fmt: skip
def test_what_hangs_on_the_handle_of_a_person_with_other_traits(patient, traits, weight):
    takes = PEOPLE[patient].with_traits(traits).takes_hold()
    arm = with_traits(load_world().arm, takes.traits, takes.values)
    assert arm_force(arm).weight == pytest.approx(weight)


@pytest.mark.parametrize(("trait", "said"), [
    ("wieght=5", "'wieght' is unknown; there are weight from 0 to 60 N, carried from 0 to 1"),
    ("weight=nan", "weight = nan: a finite number is wanted"),
    ("carried=2", "carried = 2.0: above the largest allowed, 1"),
    ("carried", "'carried': NAME=NUMBER is wanted, such as carried=0"),
])  # fmt: skip
def test_an_odd_trait_on_the_command_line_is_refused_as_by_the_service(trait, said):
    done = CliRunner().invoke(therapy.therapy, ["--trait", trait])
    assert done.exit_code == 2
    assert said in " ".join(done.output.split())


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


def test_a_game_in_the_plane_is_followed_in_the_plane():
    """The game of the browser leaves the height alone; its patient never moved."""
    robot = PlayedRobot()
    player = SimulatedPlayer(robot, PEOPLE[HEALTHY])
    for x in (0.1, 0.1, 0.1 + 1e-3, -0.1):
        robot.hear(EndpointSetpoint(position=Point(x=x, y=0.05, z=math.nan)))
        player.look()
    assert [point[:2] for point in robot.sent] == [(0.1, 0.05), (-0.1, 0.05)]
    assert all(math.isnan(point[2]) for point in robot.sent)


def test_targets_lie_evenly_on_the_circle_the_first_away_from_the_patient():
    points = targets()
    assert points[0] == pytest.approx((0.0, RADIUS))
    assert points[2] == pytest.approx((RADIUS, 0.0))
    assert [math.hypot(*point) for point in points] == pytest.approx([RADIUS] * 8)


def test_out_to_each_target_and_back_one_after_the_other_within_the_time():
    ways = centre_out(16.0, targets())
    assert len(ways) == 16
    for out, back, point in zip(ways[::2], ways[1::2], targets(), strict=True):
        assert (out.start, out.end) == ((0.0, 0.0), point)
        assert (back.start, back.end) == (point, (0.0, 0.0))
    for way, following in zip(ways, ways[1:], strict=False):
        assert way.begin + way.duration == pytest.approx(following.begin - 0.1)
    assert ways[-1].begin + ways[-1].duration == pytest.approx(15.9)


def test_a_way_begins_and_ends_at_rest_and_its_velocity_is_the_slope_of_its_position():
    way = Way(0.5, 1.8, (0.0, 0.0), (0.1, -0.05))
    for time, place in ((0.0, way.start), (0.5, way.start), (2.3, way.end), (99.0, way.end)):
        position, velocity = way.at(time)
        assert position == pytest.approx(place)
        assert velocity == pytest.approx((0.0, 0.0))
    for time in (0.7, 1.4, 1.8):
        (x0, y0), _ = way.at(time - 1e-6)
        (x1, y1), _ = way.at(time + 1e-6)
        assert way.at(time)[1] == pytest.approx(((x1 - x0) / 2e-6, (y1 - y0) / 2e-6), rel=1e-4)


def test_the_hand_lets_go_once_and_takes_hold_once():
    fixtures = []
    robot = PlayedRobot()
    robot.set_fixture, robot.set_arm = fixtures.append, lambda arm: fixtures.append(arm.kind)
    hand = Hand(robot, PEOPLE[WEAK].takes_hold())
    for act in (hand.to_mark, hand.let_go, hand.plane_to_mark, hand.take_hold, hand.take_hold):
        act()
    assert fixtures == ["free", "human_arm", "weak"]
