# SPDX-License-Identifier: Apache-2.0
"""The thesis's offset in motion: what it counts, and at which ticks samples meet."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.offset import (
    MOTION_THRESHOLD,
    Spring,
    common_ticks,
    offset_held,
    offsets,
)

SPRING = Spring(100.0, 0.18)


@given(up=st.floats(0.0, 50.0), down=st.floats(0.0, 50.0))
def test_a_known_offset_is_found_each_way(up, down):
    angle = 2.0 * np.pi * np.arange(8000) * 1e-3 / 4.0
    position, velocity = 0.18 + 0.1 * np.sin(angle), 0.157 * np.cos(angle)
    force = 100.0 * (position - 0.18) + np.where(velocity > 0, up, -down)
    found = offsets(position, velocity, force, SPRING)
    assert (found.up, found.down) == pytest.approx((up, down))
    assert found.mean == pytest.approx((up + down) / 2, rel=1e-2, abs=1e-9)


def test_a_damper_is_part_of_the_offset_unless_it_is_asked_for():
    angle = 2.0 * np.pi * np.arange(8000) * 1e-3 / 4.0
    position, velocity = 0.18 + 0.1 * np.sin(angle), 0.157 * np.cos(angle)
    samples = position, velocity, 100.0 * (position - 0.18) + 6.0 * velocity
    fast = np.abs(velocity) > MOTION_THRESHOLD
    assert offsets(*samples, SPRING).mean == pytest.approx(6.0 * np.abs(velocity[fast]).mean())
    damped = SPRING._replace(damping=6.0)
    assert offsets(*samples, damped).mean == pytest.approx(0.0, abs=1e-9)
    assert offset_held(*samples, SPRING) == pytest.approx(6.0 * np.abs(velocity).mean())
    assert offset_held(*samples, damped) == pytest.approx(0.0, abs=1e-9)


def test_rest_and_slow_motion_do_not_count_nor_do_signs_cancel():
    speeds = np.array([0.0, MOTION_THRESHOLD, -MOTION_THRESHOLD, 0.1, 0.1])
    forces = np.array([99.0, 99.0, 99.0, 3.0, -3.0])
    found = offsets(np.full(5, 0.18), speeds, forces, SPRING)
    assert (found.up, found.mean) == (3.0, 3.0)
    assert np.isnan(found.down)


@pytest.mark.parametrize(
    ("first", "second", "met"),
    [
        ([5, 6, 8, 9], [4, 6, 7, 8, 8], [6, 8]),
        ([2**32 - 2, 2**32 - 1, 0, 1], [2**32 - 1, 0, 1], [2**32 - 1, 0, 1]),  # may roll over
    ],
)
def test_samples_meet_at_the_ticks_both_have(first, second, met):
    first, second = np.array(first, np.uint32), np.array(second, np.uint32)
    in_first, in_second = common_ticks(first, second)
    assert first[in_first].tolist() == second[in_second].tolist() == met
