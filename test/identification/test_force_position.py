# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.identification.force_position import (
    MOTION_THRESHOLD,
    Spring,
    common_ticks,
    offset,
    offsets,
    spring_force,
)

SPRING = Spring(100.0, 0.18)


def sine(up: float, down: float, samples: int = 8000):
    """Return height, speed and force of a sine through the spring with a known offset each way."""
    time = np.arange(samples) * 1e-3
    position = 0.18 + 0.1 * np.sin(2 * np.pi * time / 4.0)
    velocity = 0.1 * 2 * np.pi / 4.0 * np.cos(2 * np.pi * time / 4.0)
    force = 100.0 * (position - 0.18) + np.where(velocity > 0, up, -down)
    return position, velocity, force


def test_the_spring_needs_a_push_upward_above_its_centre():
    assert spring_force(np.array([0.28, 0.18, 0.08]), SPRING) == pytest.approx([10.0, 0.0, -10.0])


def test_offset_is_what_the_patient_pushes_beyond_the_spring():
    assert offset(np.array([0.28]), np.array([14.0]), SPRING) == pytest.approx([4.0])


@given(up=st.floats(0.0, 50.0), down=st.floats(0.0, 50.0))
def test_a_known_offset_is_found_each_way(up, down):
    found = offsets(*sine(up, down), SPRING)
    assert found.up == pytest.approx(up)
    assert found.down == pytest.approx(down)
    assert found.bias_up == pytest.approx(up)
    assert found.bias_down == pytest.approx(-down)
    assert found.mean == pytest.approx((up + down) / 2, rel=1e-2, abs=1e-9)


def test_both_ways_count_by_their_samples():
    position = np.full(4, 0.18)
    velocity = np.array([0.1, -0.1, -0.1, -0.1])
    force = np.array([8.0, -4.0, -4.0, -4.0])
    assert offsets(position, velocity, force, SPRING).mean == pytest.approx(5.0)


def test_signs_do_not_cancel_within_one_way():
    found = offsets(np.full(2, 0.18), np.full(2, 0.1), np.array([6.0, -6.0]), SPRING)
    assert (found.up, found.bias_up) == (6.0, 0.0)


def test_rest_and_slow_motion_do_not_count():
    speeds = np.array([0.0, MOTION_THRESHOLD, -MOTION_THRESHOLD, 2 * MOTION_THRESHOLD])
    found = offsets(np.full(4, 0.18), speeds, np.array([99.0, 99.0, 99.0, 3.0]), SPRING)
    assert (found.up, found.samples_up, found.samples_down) == (3.0, 1, 0)
    assert np.isnan(found.down)


def test_a_lower_threshold_lets_slower_motion_in():
    found = offsets(np.full(1, 0.18), np.array([0.005]), np.array([3.0]), SPRING, threshold=0.001)
    assert found.up == 3.0


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"force": np.zeros(3)}, "one length"),
        ({"velocity": np.full(2, np.nan)}, "velocity holds values that are not finite"),
        ({"threshold": 0.0}, "positive speed"),
        ({"position": np.zeros((2, 2))}, "one length"),
    ],
)
def test_what_cannot_be_evaluated_is_refused(change, told):
    good = {"position": np.zeros(2), "velocity": np.zeros(2), "force": np.zeros(2)}
    with pytest.raises(ValueError, match=told):
        offsets(**{**good, "spring": SPRING, **change})


def test_samples_meet_at_the_ticks_both_have():
    first = np.array([5, 6, 8, 9], np.uint32)
    second = np.array([4, 6, 7, 8, 8], np.uint32)
    in_first, in_second = common_ticks(first, second)
    assert first[in_first].tolist() == [6, 8]
    assert second[in_second].tolist() == [6, 8]


def test_tick_numbers_may_roll_over():
    first = np.array([2**32 - 2, 2**32 - 1, 0, 1], np.uint32)
    in_first, in_second = common_ticks(first, first[1:])
    assert in_first.tolist() == [1, 2, 3]
    assert in_second.tolist() == [0, 1, 2]


def test_nothing_meets_nothing():
    in_first, in_second = common_ticks(np.array([], np.uint32), np.array([], np.uint32))
    assert len(in_first) == len(in_second) == 0
