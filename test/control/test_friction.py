# SPDX-License-Identifier: Apache-2.0
"""The friction model against the thesis's printed figures, and its behaviour at every edge."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from law_runs import MODEL

from screw_module_ros.control.friction import (
    FALL_TIME,
    Presliding,
    compare_step,
    friction_force,
)

heights = st.floats(-0.1, 0.5)
speeds = st.floats(-3.0, 3.0)


def printed(z, v):
    """Friction alone as section 5.2.5 prints it, z [mm], v [mm/s], written out independently."""
    wave = 2 * math.pi / 19.05 * z + 0.385
    if v > 0:
        trend = (
            -7.27e-16 * z**7 - 9.97e-14 * z**6 + 6.63e-10 * z**5 - 3.54e-7 * z**4 + 7.57e-5 * z**3
            - 0.0069 * z**2 + 0.2334 * z + 13.6820
        )  # fmt: skip
        ripple = (
            1.17e-11 * z**5 - 8.14e-9 * z**4 + 1.42e-6 * z**3 + 2.13e-6 * z**2 + 5.55e-7 * z
            - 0.0052
        ) * math.sin(wave)  # fmt: skip
        factor = 0.754 * v**0.15 if v <= 2.5 else 0.00296 * v + 0.857
    else:
        trend = (
            4.76e-15 * z**7 - 5.56e-12 * z**6 + 2.50e-9 * z**5 - 5.39e-7 * z**4 + 5.66e-5 * z**3
            - 0.0028 * z**2 + 0.0676 * z + 2.7001
        )  # fmt: skip
        ripple = (
            2.59e-11 * z**5 - 1.49e-8 * z**4 + 2.01e-6 * z**3 + 2.59e-6 * z**2 + 1.14e-7 * z
            - 0.0038
        ) * math.sin(wave + (math.pi if z <= 212.5 else 0.0))  # fmt: skip
        factor = 0.8098 * (-v) ** 0.15 if -v <= 2.5 else 0.0025 * -v + 0.923
    return factor * (trend + ripple - 10.0)


@given(st.floats(0.0, 355.0), st.floats(2.0, 150.0), st.sampled_from([-1, 1]))
def test_the_printed_model_in_its_range(z, speed, sign):
    found = friction_force(MODEL, z / 1000.0, sign * speed / 1000.0)
    assert found == pytest.approx(printed(z, sign * speed), abs=1e-6)


@pytest.mark.parametrize(
    ("z", "sign", "trend"),
    [(0, 1, 13.7), (200, 1, 20.0), (350, 1, 14.7), (0, -1, 2.7), (200, -1, -0.3), (350, -1, -6.0)],
)
def test_mean_friction_is_the_thesis_figure_within_the_ripple(z, sign, trend):
    mean_speed = 0.0483 if sign > 0 else 0.0308  # where Fv = 1
    found = friction_force(MODEL, z / 1000.0, sign * mean_speed) + 10.0
    assert found == pytest.approx(trend, abs=2.2 if sign > 0 else 3.2)


def test_no_force_at_rest():
    assert friction_force(MODEL, 0.18, 0.0) == 0.0


@given(heights, speeds)
def test_never_against_the_motion_and_never_beyond_the_map(position, velocity):
    force = friction_force(MODEL, position, velocity)
    assert force * velocity >= 0.0
    assert abs(force) < 25.0


@given(heights, st.floats(-0.0021, 0.0021), st.floats(-0.0021, 0.0021))
def test_slope_round_rest_is_bounded(position, one, other):
    difference = friction_force(MODEL, position, one) - friction_force(MODEL, position, other)
    # The steepest place of the thesis's map: 8480 Ns/m at 0.3275 m, downward.
    assert abs(difference) <= 8500.0 * abs(one - other) + 1e-9


@given(heights, speeds)
def test_held_outside_the_fitted_range(position, velocity):
    held = friction_force(MODEL, min(0.355, max(0.0, position)), min(0.15, max(-0.15, velocity)))
    assert friction_force(MODEL, position, velocity) == held


@pytest.mark.parametrize(
    ("modelled", "found", "velocity", "ratio"),
    [
        (10.0, 5.0, 0.2, 0.95),
        (10.0, 100.0, 0.2, 1.01),  # twice the model counts at most, and it rises slowly
        (1.0, 0.5, 0.005, 0.95),
        (0.99, 0.5, 0.2, 1.0),  # too little friction, too slow, or against the motion
        (10.0, 5.0, 0.0049, 1.0),
        (10.0, 5.0, -0.2, 1.0),
    ],
)
def test_the_ratio_of_found_to_modelled_friction(modelled, found, velocity, ratio):
    """It starts at one; the step is a tenth of the time in which it falls."""
    memory = Presliding(modelled=modelled)
    compare_step(memory, found, velocity, 0.1 * FALL_TIME)
    assert memory.ratio == pytest.approx(ratio)


def test_a_force_that_is_too_large_only_above_the_break_is_found():
    """There the power of the speed ends, and a line begins that falls to the fastest speed."""
    up = MODEL.up._replace(high_offset=100.0, high_slope=-99.9 / MODEL.fastest_mm_s)
    assert MODEL.flaw() == ""
    assert "up" in MODEL._replace(up=up).flaw()
