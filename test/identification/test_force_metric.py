# SPDX-License-Identifier: Apache-2.0
"""Force error over all samples, and the thesis's offset: what each figure counts."""

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
    offset_held,
    offsets,
)

TIME = np.arange(5000) * 0.001
NOTHING = np.zeros_like(TIME)
SPRING = Spring(100.0, 0.18)


def of(error, position=NOTHING, velocity=NOTHING, **more):
    """Metric of a force that is off spring and damper by `error`."""
    force = 100.0 * position + 7.0 * velocity + error
    return judged(0.001, position, velocity, force, np.ones_like(TIME), 100.0, 7.0, **more)


def sine(hertz):
    return np.sin(2.0 * math.pi * hertz * TIME)


def test_the_impedance_asked_for_is_no_error():
    position = 0.1 * np.sin(2.0 * TIME)
    found = of(NOTHING, position, 0.2 * np.cos(2.0 * TIME))
    assert found.rms == pytest.approx(0.0, abs=1e-9)
    assert found.travel == pytest.approx(np.ptp(position[-1000:]))


@pytest.mark.parametrize(
    ("error", "given", "expected"),
    [
        # The thesis's offset drops everything slower than 20 mm/s: this handle does not move.
        (np.full_like(TIME, 3.0), {}, {"mean": 3.0, "rms": 3.0, "p99": 3.0, "rapid": 0.0}),
        (math.sqrt(2.0) * sine(2.0), {}, {"rms": 1.0, "rapid": 0.0}),
        (math.sqrt(2.0) * sine(60.0), {}, {"rms": 1.0, "rapid": 1.0}),
        # Shaking is as long as it lasts, and this one ends long before the last second.
        (np.where((TIME > 1.0) & (TIME < 2.2), 5.0 * sine(20.0), 0.0), {},
         {"shaking": 1.2, "swing": 0.0}),
        # What came before the first sample is not judged.
        (np.where(TIME < 2.0, 50.0, 1.0), {"first": 3000}, {"rms": 1.0}),
    ],
)  # fmt: skip
def test_each_figure_counts_its_own(error, given, expected):
    found = of(error, **given)
    for name, value in expected.items():
        margin = {"shaking": 0.15, "rapid": 0.05, "swing": 0.1}.get(name, 0.01)
        assert getattr(found, name) == pytest.approx(value, abs=margin), name


def test_too_few_samples_are_refused():
    with pytest.raises(ValueError, match="at least 1000 are wanted"):
        of(NOTHING, first=4500)


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
