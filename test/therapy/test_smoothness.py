# SPDX-License-Identifier: Apache-2.0
"""Smoothness against numbers computed elsewhere and against closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.control.minimum_jerk import pace
from screw_module_ros.therapy.smoothness import dimensionless_jerk, log_dimensionless_jerk, sparc

BELL = np.exp(-5.0 * np.arange(-1.0, 1.0, 0.01) ** 2)


def reach(rate, duration=1.0):
    """Speed of a minimum-jerk reach, both ends included."""
    count = round(rate * duration)
    return np.array([pace(k / count) for k in range(count + 1)])


def test_published_bell_curve():
    assert sparc(BELL, 100.0) == pytest.approx(-1.41403, abs=5e-6)
    assert dimensionless_jerk(BELL, 100.0) == pytest.approx(-335.74684, abs=5e-5)
    assert log_dimensionless_jerk(BELL, 100.0) == pytest.approx(-5.81636, abs=5e-6)


def test_minimum_jerk_in_closed_form():
    """|DLJ| = 720 / 1.875^2; a finite rate gives less, at 200 Hz -5.273 over 1 s."""
    fine = reach(20000.0)
    assert dimensionless_jerk(fine, 20000.0) == pytest.approx(-720.0 / 1.875**2, rel=2e-3)
    assert log_dimensionless_jerk(fine, 20000.0) == pytest.approx(-5.32203, abs=2e-3)
    assert log_dimensionless_jerk(reach(200.0)[:-1], 200.0) == pytest.approx(-5.273, abs=1e-3)


@given(st.floats(0.01, 100.0))
def test_neither_scale_nor_pauses_of_the_unit_matter(scale):
    assert sparc(scale * BELL, 100.0) == pytest.approx(sparc(BELL, 100.0))
    assert dimensionless_jerk(scale * BELL, 50.0) == pytest.approx(dimensionless_jerk(BELL, 100.0))


def test_a_second_submovement_and_a_tremor_are_less_smooth():
    time = np.arange(0.0, 2.0, 0.005)
    smooth = np.exp(-5.0 * (time - 1.0) ** 2)
    twice = np.exp(-20.0 * (time - 0.6) ** 2) + np.exp(-20.0 * (time - 1.4) ** 2)
    shaken = smooth + 0.1 * np.sin(2.0 * math.pi * 5.0 * time) ** 2
    for worse in (twice, shaken):
        assert sparc(worse, 200.0) < sparc(smooth, 200.0) - 0.1
        assert log_dimensionless_jerk(worse, 200.0) < log_dimensionless_jerk(smooth, 200.0) - 0.5


def test_rest_has_no_smoothness_and_nonsense_is_refused():
    for measure in (sparc, dimensionless_jerk, log_dimensionless_jerk):
        assert math.isnan(measure(np.zeros(100), 200.0))
        assert math.isnan(measure([], 200.0))
        with pytest.raises(ValueError, match="rate"):
            measure(BELL, 0.0)
        with pytest.raises(ValueError, match="finite"):
            measure([1.0, math.nan, 1.0], 200.0)
