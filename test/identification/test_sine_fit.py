# SPDX-License-Identifier: Apache-2.0
"""A sine of known frequency is found again, with an honest standard error."""

from __future__ import annotations

import cmath

import numpy as np
import pytest

from screw_module_ros.identification.sine_fit import fit_sine, response

TIME = np.arange(2000) / 2000.0


def test_amplitude_phase_and_offset():
    found = fit_sine(TIME, 3.0 * np.cos(2.0 * np.pi * 7.3 * TIME + 0.4) - 2.0, 7.3)
    assert found.amplitude == pytest.approx(3.0 * cmath.exp(0.4j), abs=1e-12)
    assert found.offset == pytest.approx(-2.0, abs=1e-12)
    assert found.residual < 1e-12


def test_drift_is_taken_out():
    values = np.sin(2.0 * np.pi * 1.3 * TIME) + 0.5 * TIME
    assert abs(fit_sine(TIME, values, 1.3).amplitude - -1j) > 0.02
    assert fit_sine(TIME, values, 1.3, drift=True).amplitude == pytest.approx(-1j, abs=1e-12)


def test_standard_error_is_the_scatter_of_repeated_fits():
    draw = np.random.default_rng(1)
    clean = np.cos(2.0 * np.pi * 20.0 * TIME)
    fits = [fit_sine(TIME, clean + draw.normal(0.0, 0.3, TIME.size), 20.0) for _ in range(300)]
    scatter = np.std([fit.amplitude.real for fit in fits])
    assert np.mean([fit.error for fit in fits]) == pytest.approx(scatter, rel=0.15)


def test_response_is_answer_over_input():
    phase = 2.0 * np.pi * 12.0 * TIME
    found = response(TIME, 2.2 * np.sin(phase), 1.1 * np.sin(phase - 0.7), 12.0)
    assert found.value == pytest.approx(0.5 * cmath.exp(-0.7j), abs=1e-12)


@pytest.mark.parametrize(
    ("time", "frequency", "words"),
    [
        (TIME[:3], 10.0, "3 samples do not determine"),
        (TIME, 1000.0, "do not determine"),  # Nyquist: sampled at its zeros
        (TIME, 0.0, "cannot be fitted"),
        (TIME[:20], 1e-3, "do not determine"),  # 1e-5 of a cycle
    ],
)
def test_what_cannot_be_determined_is_refused(time, frequency, words):
    with pytest.raises(ValueError, match=words):
        fit_sine(time, np.cos(time), frequency)


def test_samples_that_are_no_numbers_are_refused():
    with pytest.raises(ValueError, match="finite"):
        fit_sine(TIME, np.full_like(TIME, np.nan), 10.0)


def test_no_input_is_refused():
    with pytest.raises(ValueError, match="no sine of 10 Hz"):
        response(TIME, np.zeros_like(TIME), np.cos(TIME), 10.0)
