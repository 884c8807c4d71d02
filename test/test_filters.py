# SPDX-License-Identifier: Apache-2.0
"""Filters, gaps between samples, and the geometry of screw and arm."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros import filters, geometry
from screw_module_ros.samples import SEQUENCE_MASK, sequence_gap


def amplitude(frequency_hz, cutoff_hz, dt, settle=1.0, measure=1.0):
    """Steady amplitude of the filter's answer to a unit sine."""
    lowpass = filters.Lowpass()
    filters.tune(lowpass, cutoff_hz, dt)
    sine = cosine = 0.0
    steps, skip = round((settle + measure) / dt), round(settle / dt)
    for k in range(steps):
        phase = 2 * math.pi * frequency_hz * k * dt
        y = filters.smoothed(lowpass, math.sin(phase))
        if k >= skip:
            sine += y * math.sin(phase) * 2 * dt / measure
            cosine += y * math.cos(phase) * 2 * dt / measure
    return math.hypot(sine, cosine)


@pytest.mark.parametrize("rate_hz", [200, 500, 1000, 2000])
def test_three_decibels_down_at_the_cutoff_at_any_rate(rate_hz):
    assert amplitude(30.0, 30.0, 1.0 / rate_hz) == pytest.approx(math.sqrt(0.5), abs=2e-3)


def test_first_order_slope_a_decade_up():
    assert amplitude(300.0, 30.0, 1 / 20_000) == pytest.approx(1 / math.sqrt(101), rel=0.02)


@given(st.floats(-1e3, 1e3), st.floats(1.0, 100.0))
def test_a_constant_passes_unchanged(level, cutoff_hz):
    lowpass = filters.Lowpass(x=level, y=level)
    filters.tune(lowpass, cutoff_hz, 0.001)
    assert filters.smoothed(lowpass, level) == pytest.approx(level, abs=1e-9)


@given(st.lists(st.floats(-1.0, 1.0), max_size=200), st.floats(0.1, 5000.0))
def test_output_never_exceeds_the_largest_input(inputs, cutoff_hz):
    lowpass = filters.Lowpass()
    filters.tune(lowpass, cutoff_hz, 0.001)
    for x in inputs:
        assert abs(filters.smoothed(lowpass, x)) <= 1.0 + 1e-12


def test_high_pass_is_what_two_low_passes_leave():
    highpass = filters.Highpass()
    filters.tune_highpass(highpass, 6.0, 0.001)
    assert filters.rapid(highpass, 1.0) > 0.9
    assert [filters.rapid(highpass, 1.0) for _ in range(1000)][-1] == pytest.approx(0.0, abs=1e-9)
    filters.clear_highpass(highpass)
    assert filters.rapid(highpass, 0.0) == 0.0


def test_derivative_of_a_ramp_is_its_slope():
    lowpass = filters.Lowpass()
    filters.tune(lowpass, 6.0, 0.001)
    for tick in range(1000):
        slope = filters.derivative(lowpass, 0.3 * tick * 0.001)
    assert slope == pytest.approx(0.3, rel=1e-3)


def velocity_of(positions, periods=1, cutoff_hz=400.0):
    """Velocity after these positions at 1 kHz; periods: from the last but one to the last."""
    coefficients = filters.lowpass_coefficients(cutoff_hz, 0.001)
    state, velocity = filters.velocity_settled(positions[0]), 0.0
    for position in positions[1:-1]:
        velocity, state = filters.velocity_step(coefficients, state, position, 0.001)
    return filters.velocity_step(coefficients, state, positions[-1], periods * 0.001, periods)


def test_velocity_of_one_count_a_period():
    """Backward difference of eq 3.2: 0.9525 mm/s."""
    velocity, state = velocity_of([9.525e-7 * k for k in range(50)])
    assert velocity == pytest.approx(9.525e-4)
    assert state == pytest.approx((49 * 9.525e-7, 9.525e-4, 9.525e-4))


@pytest.mark.parametrize("cutoff_hz", [5.0, 30.0, 250.0])
@pytest.mark.parametrize("step", [9.525e-7, -9.525e-7, 1e-3])
def test_at_rest_the_velocity_becomes_zero_and_not_the_smallest_number(cutoff_hz, step):
    """A low pass alone divided it down to 5e-324 and stayed there: bags were full of it."""
    coefficients = filters.lowpass_coefficients(cutoff_hz, 0.001)
    velocity, state = filters.velocity_step(
        coefficients, filters.velocity_settled(0.0), step, 0.001
    )
    seen = [velocity]
    while velocity != 0.0 and len(seen) < 2000:
        velocity, state = filters.velocity_step(coefficients, state, step, 0.001)
        seen.append(velocity)
    assert velocity == state.smooth == 0.0
    assert min(map(abs, seen[:-1])) >= filters.AT_REST
    velocity, state = filters.velocity_step(coefficients, state, 2.0 * step, 0.001)
    assert velocity == pytest.approx(seen[0]), "it moves again"


@pytest.mark.parametrize("periods", [2, filters.LONGEST_GAP])
def test_lost_samples_count_as_an_even_motion(periods):
    even, _ = velocity_of([0.001 * k for k in range(9 + periods)], cutoff_hz=30.0)
    seen = [0.001 * k for k in range(9)]
    lost, _ = velocity_of([*seen, 0.001 * (8 + periods)], periods, 30.0)
    assert lost == pytest.approx(even)
    assert lost < 0.99, "the filter has not settled"


def test_after_too_many_lost_samples_the_velocity_starts_again():
    periods = filters.LONGEST_GAP + 1
    lost, state = velocity_of([0.0, 0.0, 0.001 * periods], periods, 30.0)
    assert lost == state.raw == state.smooth == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("previous", "current", "gap"),
    [(4, 5, 0), (4, 7, 2), (4, 4, -1), (4, 3, -2), (SEQUENCE_MASK, 0, 0), (0, SEQUENCE_MASK, -2)],
)
def test_gap_counts_missing_ticks(previous, current, gap):
    assert sequence_gap(previous, current) == gap


@given(st.integers(0, 2**62), st.integers(0, 2**31 - 1))
def test_gap_is_the_ticks_between(tick, missed):
    later = tick + missed + 1
    gap = sequence_gap(tick & SEQUENCE_MASK, later & SEQUENCE_MASK)
    assert gap == missed if missed < 2**31 - 1 else gap in (missed, -(2**31) - 1)


angles = st.floats(-math.pi, math.pi)


def test_one_count_is_the_thesis_resolution():
    assert geometry.counts_to_height(1) == pytest.approx(9.525e-7, rel=1e-9)


def test_continuous_torque_lifts_138_newton():
    assert geometry.torque_to_force(0.42) == pytest.approx(138.5, abs=0.05)


def test_one_turn_lifts_one_lead():
    assert geometry.counts_to_height(20_000) == pytest.approx(0.01905)


@given(st.floats(-1.0, 1.0))
def test_force_and_torque_undo_each_other(value):
    assert geometry.torque_to_force(geometry.force_to_torque(value)) == pytest.approx(value)


def test_arm_along_the_axes():
    assert geometry.forward(0.0, 0.0) == pytest.approx((0.4064 + 0.51435, 0.60))
    assert geometry.forward(0.0, -math.pi / 2) == pytest.approx((0.4064, 0.60 - 0.51435))


@pytest.mark.parametrize("base_y", [0.60, -0.60])
@pytest.mark.parametrize("side", ["right", "left"])
@given(x=st.floats(-0.19, 0.19), y=st.floats(-0.228, 0.228))
def test_inverse_reaches_the_whole_workspace_with_the_elbow_on_its_side(base_y, side, x, y):
    arm = geometry.PlanarArm(base_y=base_y, elbow=side)
    shoulder, elbow = geometry.inverse(x, y, arm)
    assert geometry.forward(shoulder, elbow, arm) == pytest.approx((x, y), abs=1e-9)
    assert 0.0 < abs(elbow - shoulder) < math.pi
    at_x, at_y = (arm.upper_arm * wave(shoulder) for wave in (math.cos, math.sin))
    line = x * at_y / (y - base_y)  # of the line from the base to the handle, beside the elbow
    assert at_x > line if side == "right" else at_x < line


@given(st.floats(-10.0, 10.0), st.floats(-10.0, 10.0))
def test_inverse_out_of_reach_stays_finite(x, y):
    assert all(math.isfinite(angle) for angle in geometry.inverse(x, y))


def test_inverse_out_of_reach_points_at_the_target():
    shoulder, elbow = geometry.inverse(0.0, -5.0)
    assert (shoulder, elbow) == pytest.approx((-math.pi / 2, -math.pi / 2))


@given(angles, angles)
def test_jacobian_is_the_derivative_of_forward(shoulder, elbow):
    step = 1e-6
    x_s, x_e, y_s, y_e = geometry.jacobian(shoulder, elbow)
    ahead, behind = (
        geometry.forward(shoulder + step, elbow),
        geometry.forward(shoulder - step, elbow),
    )
    assert ((ahead[0] - behind[0]) / (2 * step), (ahead[1] - behind[1]) / (2 * step)) == (
        pytest.approx((x_s, y_s), abs=1e-8)
    )
    ahead, behind = (
        geometry.forward(shoulder, elbow + step),
        geometry.forward(shoulder, elbow - step),
    )
    assert ((ahead[0] - behind[0]) / (2 * step), (ahead[1] - behind[1]) / (2 * step)) == (
        pytest.approx((x_e, y_e), abs=1e-8)
    )
