# SPDX-License-Identifier: Apache-2.0
"""Counts that wrap; position and velocity of nut and joints, homed on the host."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.devices.motion import FULL_RANGE, Motion, Unwrapper
from screw_module_ros.filters import LONGEST_GAP

MS = 1_000_000


def moving(samples: int, speed: float = 0.1) -> Motion:
    motion = Motion(30.0, MS)
    for sample in range(samples):
        motion.take(5.0 + speed * sample * 1e-3, MS)
    return motion


def test_at_rest_until_the_second_sample():
    motion = Motion(30.0, MS)
    assert not motion.seen
    motion.take(5.0, MS)
    assert (motion.seen, motion.position, motion.velocity, motion.homed) == (True, 5.0, 0.0, False)


def test_the_filter_lags_by_its_time_constant_and_arrives():
    assert 0.05 < moving(6).velocity < 0.07  # 5.3 ms at 30 Hz
    assert moving(100).velocity == pytest.approx(0.1, rel=1e-6)


def test_homing_moves_the_position_and_not_the_velocity():
    motion = moving(100)
    velocity = motion.velocity
    motion.home(0.25)
    assert (motion.position, motion.homed) == (0.25, True)
    motion.take(5.0 + 0.1 * 0.1, MS)
    assert motion.position == pytest.approx(0.2501)
    assert motion.velocity == pytest.approx(velocity)


def test_lost_samples_are_filtered_through_and_a_long_gap_starts_anew():
    motion = moving(100)
    motion.take(motion.position + 0.2 * 3e-3, 3 * MS)
    assert 0.1 < motion.velocity < 0.2
    motion.take(motion.position + 0.3 * 1e-3 * (LONGEST_GAP + 1), (LONGEST_GAP + 1) * MS)
    assert motion.velocity == pytest.approx(0.3)


def test_restart_forgets_the_home_position():
    motion = moving(3)
    motion.home(0.2)
    motion.restart()
    assert not motion.homed and not motion.seen


@given(st.integers(2, FULL_RANGE), st.lists(st.floats(-0.499, 0.499), max_size=50), st.data())
def test_any_walk_with_steps_below_half_a_range_is_followed(measuring_range, steps, data):
    true = data.draw(st.integers(-(measuring_range // 2), (measuring_range - 1) // 2))
    unwrapper = Unwrapper(measuring_range)
    assert unwrapper.step(true % measuring_range) == true
    for step in steps:
        true += int(step * measuring_range)
        assert unwrapper.step(true % measuring_range) == true


@pytest.mark.parametrize("measuring_range", [0, 1, FULL_RANGE + 1])
def test_ranges_that_cannot_be(measuring_range):
    with pytest.raises(ValueError, match="measuring_range"):
        Unwrapper(measuring_range)
