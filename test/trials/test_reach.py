# SPDX-License-Identifier: Apache-2.0
import math

import pytest

from screw_module_ros.trials.reach import RADIUS, centre_out, on_way, targets


def test_targets_lie_evenly_on_the_circle_the_first_away_from_the_patient():
    points = targets()
    assert points[0] == pytest.approx((0.0, RADIUS))
    assert points[2] == pytest.approx((RADIUS, 0.0))
    assert [math.hypot(*point) for point in points] == pytest.approx([RADIUS] * 8)


def test_out_to_each_target_and_back():
    ways = centre_out(16.0, targets())
    assert len(ways) == 16
    for out, back, point in zip(ways[::2], ways[1::2], targets(), strict=True):
        assert (out.start, out.end) == ((0.0, 0.0), point)
        assert (back.start, back.end) == (point, (0.0, 0.0))


def test_ways_follow_each_other_within_the_time():
    ways = centre_out(16.0, targets(), rest=0.2)
    for way, following in zip(ways, ways[1:], strict=False):
        assert way.begin + way.duration == pytest.approx(following.begin - 0.2)
    assert ways[-1].begin + ways[-1].duration == pytest.approx(15.8)


def test_a_way_begins_and_ends_at_rest():
    way = centre_out(4.0, [(0.1, 0.0)])[0]
    for time, place in ((way.begin, way.start), (way.begin + way.duration, way.end)):
        position, velocity = on_way(way, time)
        assert position == pytest.approx(place)
        assert velocity == (0.0, 0.0)
    assert on_way(way, 99.0)[0] == pytest.approx(way.end)


def test_velocity_is_the_slope_of_position():
    way = centre_out(4.0, [(0.1, -0.05)])[0]
    for time in (0.2, 0.9, 1.3):
        (x0, y0), _ = on_way(way, time - 1e-6)
        (x1, y1), _ = on_way(way, time + 1e-6)
        _, velocity = on_way(way, time)
        assert velocity == pytest.approx(((x1 - x0) / 2e-6, (y1 - y0) / 2e-6), rel=1e-4)


@pytest.mark.parametrize(
    ("duration", "points", "rest"), [(0.0, [(0.1, 0.0)], 0.1), (4.0, [], 0.1), (4.0, [(1, 0)], 1.0)]
)
def test_no_time_to_move_is_refused(duration, points, rest):
    with pytest.raises(ValueError, match="no time to move"):
        centre_out(duration, points, rest)
