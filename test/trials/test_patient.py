# SPDX-License-Identifier: Apache-2.0
"""The hand on the handle, the centre-out reach, traits on the command line."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest
from click.testing import CliRunner

from screw_module_ros.operator.robot import arm
from screw_module_ros.trials import therapy
from screw_module_ros.trials.patient import RADIUS, Hand, Way, centre_out, targets


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
