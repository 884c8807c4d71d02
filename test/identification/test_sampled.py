# SPDX-License-Identifier: Apache-2.0
"""Responses between a hold and a sampler: closed form, folded sum and simulation agree."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest

from screw_module_ros.identification import sampled as models
from screw_module_ros.identification.sampled import fit_sine, response
from screw_module_ros.plant.instruments import (
    CurrentSensorState,
    Transducer,
    current_sensor_params,
    current_sensor_step,
    rotor_step,
    rotor_step_settings,
)

FREQUENCIES = np.geomspace(1.0, 400.0, 9)
AMPLIFIER = models.first_order(1000.0)
ROTOR = models.second_order(1.96e-5, 7.2, 1e4)
LIGHT = models.second_order(1.96e-5, 0.005, 1e4)
CHAINS = {
    "amplifier": AMPLIFIER,
    "sensor": models.series(AMPLIFIER, models.current_sensor()),
    "rotor": models.series(AMPLIFIER, ROTOR),
    "resonance": models.series(AMPLIFIER, LIGHT),
    "equal poles": models.series(AMPLIFIER, AMPLIFIER),
}


def folded(chain, rate, delay, terms=2000):
    """The response added up over n = -terms to terms (thesis eq 4.2)."""
    at = np.add.outer(FREQUENCIES, np.arange(-terms, terms + 1) * rate)
    s = 2j * math.pi * at
    held = (1.0 - np.exp(-s / rate)) / s * rate
    return np.sum(models.continuous_response(chain, at, delay) * held, axis=1)


@pytest.mark.parametrize("name", CHAINS)
@pytest.mark.parametrize("delay", [0.0, 60e-6, 385e-6, 500e-6, 1290e-6])
def test_closed_form_is_the_folded_sum(name, delay):
    exact = models.sampled_response(CHAINS[name], FREQUENCIES, 2000.0, delay)
    assert np.abs(folded(CHAINS[name], 2000.0, delay) / exact - 1.0).max() < 1e-3


def test_rotor_on_the_plants_transducer():
    """The plant's step, played with 500 us holds; both sides have the equation from C.3."""
    step = rotor_step_settings(Transducer(1.96e-5, 1e4, 7.2), 5e-4)
    count, cycles = 2000, 37
    angle = velocity = 0.0
    torques = []
    for k in range(2 * count):
        torques.append(1e4 * angle)
        drive = math.sin(2.0 * math.pi * cycles * k / count)
        angle, velocity = rotor_step(step, angle, velocity, drive, 0.0)
    k = np.arange(count)
    found = 2j * np.mean(torques[count:] * np.exp(-2j * np.pi * cycles * k / count))
    expected = models.sampled_response(ROTOR, np.array([37.0]), 2000.0, 0.0)[0]
    assert found == pytest.approx(expected, rel=1e-6)


def test_current_sensor_is_the_plants():
    p, state, volts = current_sensor_params(5e-4), CurrentSensorState(), [0.0]
    for _ in range(19):
        volt, state = current_sensor_step(p, state, 1.0, 0.0)
        volts.append(volt)
    frequencies = np.fft.rfftfreq(400, 5e-4)
    impulse = np.diff(np.append(volts, np.full(380, volts[-1])), prepend=0.0)
    found = models.sampled_response(models.current_sensor(), frequencies, 2000.0, 0.0)
    assert found == pytest.approx(np.fft.rfft(impulse), abs=1e-4)


@pytest.mark.parametrize("delay", [1e-6, 250e-6, 500e-6])
def test_a_wire_is_a_whole_sample_late(delay):
    """Thesis 4.1.4: any delay up to a period looks like one period."""
    found = models.sampled_response(models.WIRE, FREQUENCIES, 2000.0, delay)
    assert found == pytest.approx(np.exp(-2j * np.pi * FREQUENCIES / 2000.0), rel=1e-9)
    drawn = models.held_twice_response(models.WIRE, np.array([10.0]), 2000.0, 0.0)
    late = -np.angle(drawn)[0] / (2.0 * math.pi * 10.0)
    assert late == pytest.approx(500e-6, rel=1e-9), "as two holds half a period more"


@pytest.mark.parametrize("noise", [[0.01], np.geomspace(1e-4, 0.03, 60)])
def test_fit_finds_the_numbers_and_their_scatter(noise):
    """Also of noise that is a larger share at high frequencies, where the answer is small."""
    draw = np.random.default_rng(3)
    frequencies = np.geomspace(1.0, 1e4, 60)

    def model(x):
        return x[0] * models.sampled_response(
            models.first_order(x[1]), frequencies, 256e3, x[2]
        )

    truth = np.array([0.9, 1000.0, 60e-6])
    begin, low, high = [1.0, 500.0, 2e-5], [0, 10, 0], [2, 1e4, 1e-3]
    noise = np.broadcast_to(noise, 60)
    noisy = model(truth) * (1.0 + noise * (draw.normal(0.0, 1.0, (40, 60, 2)) @ [1.0, 1j]))
    fits = [models.fit_response(model, measured, begin, low, high) for measured in noisy]
    values = np.array([fit.values for fit in fits])
    assert values.mean(axis=0) == pytest.approx(truth, rel=0.01)
    stated = np.array([[source.standard for source in fit.scatter] for fit in fits])
    assert np.sqrt((stated**2).mean(axis=0)) == pytest.approx(values.std(axis=0), rel=0.4)


TIME = np.arange(2000) / 2000.0


def test_amplitude_and_phase_are_found_also_beside_a_drift():
    sine = 3.0 * np.cos(2.0 * np.pi * 7.3 * TIME + 0.4) - 2.0
    found = fit_sine(TIME, sine, 7.3)
    assert found.value == pytest.approx(3.0 * cmath.exp(0.4j), abs=1e-12)
    assert found.error < 1e-12
    drifting = sine + 5.0 * TIME
    assert abs(fit_sine(TIME, drifting, 7.3).value - found.value) > 0.02
    assert fit_sine(TIME, drifting, 7.3, drift=True).value == pytest.approx(found.value, abs=1e-12)


def test_standard_error_is_the_scatter_of_repeated_fits():
    draw = np.random.default_rng(1)
    clean = np.cos(2.0 * np.pi * 20.0 * TIME)
    fits = [fit_sine(TIME, clean + draw.normal(0.0, 0.3, TIME.size), 20.0) for _ in range(300)]
    scatter = np.std([fit.value.real for fit in fits])
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
        (TIME, 0.0, "do not determine"),
        (TIME[:20], 1e-3, "do not determine"),  # 1e-5 of a cycle
    ],
)
def test_what_cannot_be_determined_is_refused(time, frequency, words):
    with pytest.raises(ValueError, match=words):
        fit_sine(time, np.cos(time), frequency)
