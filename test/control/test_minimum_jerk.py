# SPDX-License-Identifier: Apache-2.0
"""The minimum-jerk way: ends at rest, 1.875 times the mean speed half way, the closed form."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.control.minimum_jerk import PEAK_SPEED, pace, way

shares = st.floats(-1.0, 2.0)


@given(shares)
def test_stays_on_the_way_and_pace_is_its_slope(share):
    step = 1e-5
    assert 0.0 <= way(share) <= 1.0 + 1e-12
    slope = (way(share + step) - way(share - step)) / (2.0 * step)
    assert pace(share) == pytest.approx(slope, abs=1e-3)


@given(st.floats(0.0, 1.0))
def test_is_symmetric(share):
    assert way(share) + way(1.0 - share) == pytest.approx(1.0, abs=1e-12)
    assert pace(share) <= PEAK_SPEED + 1e-12


def test_closed_form():
    assert (way(0.0), way(0.5), way(1.0)) == pytest.approx((0.0, 0.5, 1.0))
    assert way(0.25) == pytest.approx(10 / 64 - 15 / 256 + 6 / 1024)
    assert (pace(0.0), pace(0.5), pace(1.0)) == pytest.approx((0.0, PEAK_SPEED, 0.0))
