# SPDX-License-Identifier: Apache-2.0
"""The hand on the handle, the centre-out reach, traits on the command line."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest
from click.testing import CliRunner

from screw_module_ros.operator.robot import arm
from screw_module_ros.plant.patient import hand_point
from screw_module_ros.trials import therapy
from screw_module_ros.trials.patient import RADIUS, Hand, centre_out, targets


@pytest.mark.parametrize(("trait", "said"), [
    ("wieght=5", "'wieght' is unknown; there are weight from 0 to 60 N, carried from 0 to 1,"),
    ("weight=nan", "weight = nan: a finite number is wanted"),
    ("carried=2", "carried = 2.0: above the largest allowed, 1"),
    ("carried", "'carried': NAME=NUMBER is wanted, such as carried=0"),
])  # fmt: skip
def test_an_odd_trait_on_the_command_line_is_refused_as_by_the_service(trait, said):
    done = CliRunner().invoke(therapy.therapy, ["--trait", trait])
    assert done.exit_code == 2
    assert said in " ".join(done.output.split())


def test_targets_lie_evenly_on_the_circle_the_first_away_from_the_patient():
    points = targets()
    assert points[0] == pytest.approx((0.0, RADIUS))
    assert points[2] == pytest.approx((RADIUS, 0.0))
    assert [math.hypot(*point) for point in points] == pytest.approx([RADIUS] * 8)


def test_out_to_each_target_and_back_one_after_the_other_within_the_time():
    ways = centre_out(16.0, targets())
    assert len(ways) == 16
    for out, back, point in zip(ways[::2], ways[1::2], targets(), strict=True):
        assert [(axis.start, axis.target) for axis in out] == [(0.0, to) for to in point]
        assert [(axis.start, axis.target) for axis in back] == [(to, 0.0) for to in point]
    for x, y in ways:
        assert (x.begin, x.duration) == (y.begin, y.duration)
    for (way, _), (following, _) in zip(ways, ways[1:], strict=False):
        assert way.begin + way.duration == pytest.approx(following.begin - 0.1)
    assert ways[-1][0].begin + ways[-1][0].duration == pytest.approx(15.9)


def test_a_way_begins_and_ends_at_rest_and_its_velocity_is_the_slope_of_its_position():
    (_, way, *_) = centre_out(8.0, [(0.1, -0.05), (0.0, 0.1)])
    for along, start in zip(way, (0.1, -0.05), strict=True):
        assert (along.begin, along.duration) == (2.0, 1.8)
        for time, place in ((0.0, start), (2.0, start), (3.8, 0.0), (99.0, 0.0)):
            assert hand_point(along, time) == pytest.approx((place, 0.0))
        for time in (2.2, 2.9, 3.3):
            (before, _), (after, _) = hand_point(along, time - 1e-6), hand_point(along, time + 1e-6)
            assert hand_point(along, time)[1] == pytest.approx((after - before) / 2e-6, rel=1e-4)


def test_the_hand_lets_go_once_and_takes_hold_once():
    fixtures = []
    robot = SimpleNamespace(
        set_fixture=fixtures.append,
        set_arm=lambda change: fixtures.append(change.patient or change.target.z),
    )
    hand = Hand(robot, arm(patient="weak"), arm((0.0, 0.0, 0.18)))
    for act in (hand.to_mark, hand.let_go, hand.plane_to_mark, hand.take_hold, hand.take_hold):
        act()
    assert fixtures == ["free", "human_arm", "weak", 0.18]
    hand.change()
    assert fixtures[4:] == ["free"] and not hand.holds
    hand.change()
    assert fixtures[5:] == ["human_arm", "weak", 0.18] and hand.holds
