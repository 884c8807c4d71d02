# SPDX-License-Identifier: Apache-2.0
"""The 30 Hz filter of thesis 3.3: -3 dB at its cutoff at any rate, unit gain at rest, bounded."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros import filters


def amplitude(frequency_hz, cutoff_hz, dt, settle=1.0, measure=1.0):
    """Steady amplitude of the filter's answer to a unit sine."""
    coefficients, state = filters.lowpass_coefficients(cutoff_hz, dt), filters.lowpass_settled(0.0)
    sine = cosine = 0.0
    steps, skip = round((settle + measure) / dt), round(settle / dt)
    for k in range(steps):
        phase = 2 * math.pi * frequency_hz * k * dt
        y, state = filters.lowpass_step(coefficients, state, math.sin(phase))
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
    coefficients = filters.lowpass_coefficients(cutoff_hz, 0.001)
    y, _ = filters.lowpass_step(coefficients, filters.lowpass_settled(level), level)
    assert y == pytest.approx(level, abs=1e-9)


@given(st.lists(st.floats(-1.0, 1.0), max_size=200), st.floats(0.1, 5000.0))
def test_output_never_exceeds_the_largest_input(inputs, cutoff_hz):
    coefficients, state = filters.lowpass_coefficients(cutoff_hz, 0.001), filters.lowpass_settled(0)
    for x in inputs:
        y, state = filters.lowpass_step(coefficients, state, x)
        assert abs(y) <= 1.0 + 1e-12


def test_back_difference_of_one_count():
    assert filters.back_difference(0.0, 9.525e-7, 0.001) == pytest.approx(9.525e-4)
