# SPDX-License-Identifier: Apache-2.0
"""Force error over all samples: sensitivity of each figure."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.identification.force_metric import (
    MOTION_THRESHOLD,
    Spring,
    common_ticks,
    judged,
    offsets,
)

DT = 0.001
TIME = np.arange(5000) * DT
NOTHING = np.zeros_like(TIME)
WHOLE = np.ones_like(TIME)


def of(error, position=NOTHING, velocity=NOTHING, stiffness=100.0, damping=7.0, **more):
    """Metric of a force that is off the impedance by `error`."""
    force = stiffness * position + damping * velocity + error
    return judged(DT, position, velocity, force, WHOLE, stiffness, damping, **more)


def test_the_impedance_asked_for_is_no_error():
    position = 0.1 * np.sin(2.0 * TIME)
    found = of(NOTHING, position, 0.2 * np.cos(2.0 * TIME))
    assert found.rms == pytest.approx(0.0, abs=1e-9)
    assert found.travel == pytest.approx(np.ptp(position[-1000:]))


def test_standstill_counts():
    """The thesis's offset drops everything slower than 20 mm/s: this handle does not move."""
    found = of(np.full_like(TIME, 3.0))
    assert found.mean == found.rms == pytest.approx(3.0)
    assert found.p99 == pytest.approx(3.0)
    assert found.rapid < 0.1


@pytest.mark.parametrize(("frequency", "rapid"), [(2.0, 0.0), (60.0, 1.0)])
def test_rapid_is_above_30_hertz(frequency, rapid):
    found = of(math.sqrt(2.0) * np.sin(2.0 * math.pi * frequency * TIME))
    assert found.rms == pytest.approx(1.0, abs=0.01)
    assert found.rapid == pytest.approx(rapid, abs=0.03)


def test_shaking_is_as_long_as_it_lasts():
    swing = np.where((TIME > 1.0) & (TIME < 2.2), 5.0 * np.sin(2.0 * math.pi * 20.0 * TIME), 0.0)
    found = of(swing)
    assert found.shaking == pytest.approx(1.2, abs=0.15)
    assert found.swing < 0.1, "it ended long before the last second"


def test_what_came_before_is_not_judged():
    found = of(np.where(TIME < 2.0, 50.0, 1.0), first=3000)
    assert found.rms == pytest.approx(1.0)


def test_too_few_samples_are_refused():
    with pytest.raises(ValueError, match="at least 1000 are wanted"):
        of(NOTHING, first=4500)


SPRING = Spring(100.0, 0.18)


def sine(up: float, down: float, samples: int = 8000):
    """Return height, speed and force of a sine through the spring with a known offset each way."""
    time = np.arange(samples) * 1e-3
    position = 0.18 + 0.1 * np.sin(2 * np.pi * time / 4.0)
    velocity = 0.1 * 2 * np.pi / 4.0 * np.cos(2 * np.pi * time / 4.0)
    force = 100.0 * (position - 0.18) + np.where(velocity > 0, up, -down)
    return position, velocity, force


@given(up=st.floats(0.0, 50.0), down=st.floats(0.0, 50.0))
def test_a_known_offset_is_found_each_way(up, down):
    found = offsets(*sine(up, down), SPRING)
    assert found.up == pytest.approx(up)
    assert found.down == pytest.approx(down)
    assert found.mean == pytest.approx((up + down) / 2, rel=1e-2, abs=1e-9)


def test_signs_do_not_cancel_within_one_way():
    found = offsets(np.full(2, 0.18), np.full(2, 0.1), np.array([6.0, -6.0]), SPRING)
    assert found.up == 6.0


def test_rest_and_slow_motion_do_not_count():
    speeds = np.array([0.0, MOTION_THRESHOLD, -MOTION_THRESHOLD, 2 * MOTION_THRESHOLD])
    found = offsets(np.full(4, 0.18), speeds, np.array([99.0, 99.0, 99.0, 3.0]), SPRING)
    assert (found.up, found.mean) == (3.0, 3.0)
    assert np.isnan(found.down)


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
