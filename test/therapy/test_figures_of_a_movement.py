# SPDX-License-Identifier: Apache-2.0
"""Speed, path, circle, hold, work, smoothness and effect sizes where they are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.control.minimum_jerk import pace, way
from screw_module_ros.therapy.columns import Trial
from screw_module_ros.therapy.hand import SPACE, HandSample
from screw_module_ros.therapy.kinematics import (
    direction_error,
    ellipse_area,
    hold_deviation,
    independence,
    moving,
    path_error,
    path_ratio,
    ratio,
    speed_peaks,
    time_in_motion,
    work_done,
)
from screw_module_ros.therapy.line import Line
from screw_module_ros.therapy.measures import computed
from screw_module_ros.therapy.protocol import REACH
from screw_module_ros.therapy.smoothness import dimensionless_jerk, log_dimensionless_jerk, sparc

RATE = 200.0
PATH_FIGURES = (path_error, path_ratio, direction_error)
START, TARGET = (0.0, 0.0, 0.2), (0.0, 0.14, 0.2)


def straight(count=281):
    path = np.zeros((count, 3)) + START
    path[:, 1] = [0.14 * way(k / (count - 1)) for k in range(count)]
    return path


def test_minimum_jerk_speed():
    speed = 0.1 * np.array([pace(k / 2000) for k in range(2001)])
    assert speed.mean() / speed.max() == pytest.approx(0.53333, abs=5e-4)
    assert (speed_peaks(speed), time_in_motion(speed)) == (1, pytest.approx(0.8, abs=0.1))


def test_peaks_are_counted_and_noise_is_none():
    time = np.arange(0.0, 3.0, 1.0 / RATE)
    speed = 0.2 * np.abs(np.sin(math.pi * time))
    assert speed_peaks(speed) == 3
    noisy = speed + 0.002 * np.cos(2.0 * math.pi * 60.0 * time)
    assert speed_peaks(noisy) == 3
    assert speed_peaks(np.linspace(0.0, 1.0, 50)) == 1


def test_arrest_counts_the_time_in_motion():
    speed = np.concatenate((np.ones(50), np.zeros(50), np.ones(100)))
    assert time_in_motion(speed) == pytest.approx(0.75)


def test_a_movement_is_what_lies_above_a_tenth_of_the_peak():
    speed = np.concatenate((np.full(40, 0.005), np.full(60, 0.1), np.full(20, 0.009)))
    assert moving(speed, RATE) == slice(40, 100)
    assert moving(0.09 * speed, RATE) is None, "peak below 0.01 m/s"
    assert moving(speed[30:59], RATE) is None, "shorter than 0.1 s"
    assert moving(np.array([]), RATE) is None


def test_straight_path():
    figures = [each(straight(), START, TARGET) for each in PATH_FIGURES]
    assert figures == pytest.approx((0.0, 1.0, 0.0), abs=1e-9)


def test_half_circle_to_the_target():
    angle = np.linspace(-math.pi / 2, math.pi / 2, 2001)
    path = np.column_stack(
        (0.07 * np.cos(angle), 0.07 + 0.07 * np.sin(angle), np.full(angle.size, 0.2))
    )
    assert path_ratio(path, START, TARGET) == pytest.approx(math.pi / 2, rel=1e-5)
    assert path_error(path, START, TARGET) == pytest.approx(2.0 * 0.07 / math.pi, rel=1e-3)
    # A chord of a fifth of the diameter starts at acos(0.2) from the diameter.
    assert direction_error(path, START, TARGET) == pytest.approx(math.acos(0.2), abs=2e-3)


def test_a_path_that_stays_has_no_direction_and_all_of_the_error():
    path = np.tile(START, (10, 1))
    assert math.isnan(direction_error(path, START, TARGET))
    assert path_ratio(path, START, TARGET) == 0.0
    for figure in PATH_FIGURES:
        with pytest.raises(ValueError, match="one point"):
            figure(straight(), START, START)


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_ellipse(turn):
    angle = np.linspace(0.0, 2.0 * math.pi, 1000, endpoint=False)
    x, y = 0.08 * np.cos(angle), 0.02 * np.sin(angle)
    path = np.column_stack(
        (
            0.1 + x * math.cos(turn) - y * math.sin(turn),
            x * math.sin(turn) + y * math.cos(turn),
            np.zeros(angle.size),
        )
    )
    assert independence(path) == pytest.approx(0.25)
    assert ellipse_area(path) == pytest.approx(math.pi * 0.08 * 0.02)


def test_hold_deviation():
    path = np.array([[0.003, 0.0, 0.2], [0.0, -0.004, 0.2]])
    assert hold_deviation(path, START) == pytest.approx(math.sqrt((9e-6 + 16e-6) / 2))


def test_work_has_two_directions():
    times = np.arange(0.0, 1.0001, 0.01)
    velocity = np.zeros((times.size, 3))
    velocity[:, 1] = 0.2
    force = np.zeros_like(velocity)
    force[:, 1] = np.where(times <= 0.5, 10.0, -5.0)
    patient, robot = work_done(force, velocity, times)
    assert patient == pytest.approx(1.0, abs=0.02)
    assert robot == pytest.approx(0.5, abs=0.02)
    force[:] = math.nan
    assert work_done(force, velocity, times) == (0.0, 0.0)
    assert math.isnan(ratio(0.0, 0.0)), "no work, no share"


def test_the_table_of_a_minimum_jerk_reach():
    """0.14 m in 1 s after 0.2 s of rest; the patient pushes at first, then the robot does.

    The movement lies above a tenth of the peak speed: 30 t^2 (1 - t)^2 > 0.1875, from 0.0865 s to
    0.9135 s.
    """
    step_ns, rest, edge = 5_000_000, 40, 0.0865
    samples = []
    for k in range(rest + 201):
        part = max(0, k - rest) / 200
        force = 10.0 if part <= 0.5 else -5.0
        samples.append(HandSample(
            k, k * step_ns, START[0], 0.14 * way(part), START[2], 0.0, 0.14 * pace(part), 0.0,
            0.0, force, 0.0,
        ))  # fmt: skip
    line = Line(START, TARGET, SPACE)
    found = computed(Trial(REACH, line, 1.4, rest * step_ns, samples[-1].time_ns, samples))
    assert found["duration"] == pytest.approx(1.0 - 2.0 * edge, abs=0.01)
    assert found["time_to_start"] == pytest.approx(0.2 + edge, abs=0.005)
    assert found["peak_speed"] == pytest.approx(1.875 * 0.14)
    assert found["mean_speed"] == pytest.approx(
        0.14 * (1.0 - 2.0 * way(edge)) / (1.0 - 2.0 * edge), rel=0.01
    )
    assert found["reach_error"] == pytest.approx(0.14 * way(edge), abs=2e-4)
    assert found["patient_work"] == pytest.approx(10.0 * 0.07, abs=0.01)
    assert found["robot_work"] == pytest.approx(5.0 * 0.07, abs=0.01)
    assert found["robot_share"] == pytest.approx(1 / 3, abs=0.01)
    assert found["pm4"] == pytest.approx(0.14)


BELL = np.exp(-5.0 * np.arange(-1.0, 1.0, 0.01) ** 2)


def minimum_jerk(rate, duration=1.0):
    """Speed of a minimum-jerk movement, both ends included."""
    count = round(rate * duration)
    return np.array([pace(k / count) for k in range(count + 1)])


def test_published_bell_curve():
    assert sparc(BELL, 100.0) == pytest.approx(-1.41403, abs=5e-6)
    assert dimensionless_jerk(BELL, 100.0) == pytest.approx(-335.74684, abs=5e-5)
    assert log_dimensionless_jerk(BELL, 100.0) == pytest.approx(-5.81636, abs=5e-6)


def test_minimum_jerk_in_closed_form():
    """|DLJ| = 720 / 1.875^2; a finite rate gives less, at 200 Hz -5.273 over 1 s."""
    fine = minimum_jerk(20000.0)
    assert dimensionless_jerk(fine, 20000.0) == pytest.approx(-720.0 / 1.875**2, rel=2e-3)
    assert log_dimensionless_jerk(fine, 20000.0) == pytest.approx(-5.32203, abs=2e-3)
    coarse = minimum_jerk(200.0)[:-1]
    assert log_dimensionless_jerk(coarse, 200.0) == pytest.approx(-5.273, abs=1e-3)


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
