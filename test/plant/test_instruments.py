# SPDX-License-Identifier: Apache-2.0
"""The instruments of the thesis: analyser, current sensor, and a rotor locked to the transducer."""

from __future__ import annotations

import cmath
import math

import numpy
import numpy as np
import pytest
from scipy import signal
from scipy.linalg import expm

from screw_module_ros.compiled import compiled
from screw_module_ros.plant.amplifier import bridge_current
from screw_module_ros.plant.instruments import (
    CurrentSensorState,
    analyzed,
    analyzer_sine,
    current_sensor_params,
    current_sensor_step,
    rotor_step,
    rotor_step_settings,
)

RATE = 256_000.0
TIME = 1.0 / (2.0 * math.pi * 1000.0)


@pytest.fixture
def linear(settings):
    return settings.amplifier._replace(dead_zone=0.0)


def test_command_is_the_sine(linear):
    command, current = analyzed(linear, 1000.0, 2.2, 0.003, RATE)
    k = np.arange(768)
    assert command == pytest.approx(2.2 * np.sin(2.0 * np.pi * 1000.0 * k / RATE), abs=1e-12)
    assert len(current) == 768


def test_nothing_comes_out_before_the_delay(linear):
    # 15.36 samples of delay; sample 1 is the first that is not zero
    _, current = analyzed(linear, 1000.0, 2.2, 0.001, RATE)
    assert not np.any(current[:17])
    assert np.all(current[17:60] > 0.0)


@pytest.mark.parametrize("frequency", [100.0, 1000.0, 10_000.0])
def test_analyser_s_frequency_response(linear, frequency):
    command, current = analyzed(linear, frequency, 2.2, 0.02, RATE)
    k = np.arange(2560, 5120)  # settled, and whole cycles
    answer = np.sum(current[k] * np.exp(-2j * np.pi * frequency * k / RATE)) * 2j / 2560 / 2.2
    half = math.pi * frequency / RATE
    hold = cmath.exp(-1j * half) * math.sin(half) / half
    omega = 2.0 * math.pi * frequency
    exact = hold * cmath.exp(-1j * omega * 60e-6) / (1.0 + 1j * omega * TIME)
    assert abs(answer / exact - 1.0) < 0.01


def test_dead_zone_takes_from_the_current(settings):
    a = settings.amplifier
    _, current = analyzed(a, 10.0, 2.2, 0.2, RATE)
    assert current.max() == pytest.approx(bridge_current(a, 2.2), rel=1e-3)
    assert current.max() < 2.06


def test_plain_and_compiled_agree(settings):
    given = (settings.amplifier, 777.0, 2.2, 0.002, RATE)
    for plain, twin in zip(analyzer_sine(*given), analyzed(*given), strict=True):
        assert plain == pytest.approx(twin, abs=1e-12)


SQUARE = 1.0 / (19_600.0 * 20_000.0 * 5e-9 * 1.5e-8)
NUMERATOR, DENOMINATOR = [3.42 * SQUARE], [1.0, 39_600.0 * 5e-9 * SQUARE, SQUARE]


def played(p, currents, step=current_sensor_step):
    state, volts = CurrentSensorState(), []
    for current in currents:
        out, state = step(p, state, current)
        volts.append(out)
    return volts


def test_printed_cutoff():
    assert math.sqrt(SQUARE) / (2.0 * math.pi) == pytest.approx(928.8, rel=1e-3)


@pytest.mark.parametrize("dt", [25e-6, 50e-6, 500e-6])
def test_current_sensor_s_step_response_is_exact(dt):
    times = [n * dt for n in range(40)]
    _, exact = signal.step((NUMERATOR, DENOMINATOR), T=times)
    assert played(current_sensor_params(dt), [1.0] * 39) == pytest.approx(exact[1:], abs=1e-6)


def test_settles_at_3_42_volts_per_ampere():
    assert played(current_sensor_params(50e-6), [2.0] * 400)[-1] == pytest.approx(6.84, rel=1e-9)


@pytest.mark.parametrize("frequency", [20.0, 200.0, 1000.0])
def test_current_sensor_s_frequency_response(frequency):
    dt, omega = 50e-6, 2.0 * math.pi * frequency
    count = round(20.0 / frequency / dt)
    volts = played(
        current_sensor_params(dt), [math.sin(omega * i * dt) for i in range(2 * count)]
    )
    answer = sum(  # output i is that of time (i + 1) dt
        volts[i] * cmath.exp(-1j * omega * (i + 1) * dt) * 2j / count
        for i in range(count, 2 * count)
    )
    half = omega * dt / 2.0
    hold = cmath.exp(-1j * half) * math.sin(half) / half
    s = 1j * omega
    exact = NUMERATOR[0] / (s * s + DENOMINATOR[1] * s + SQUARE)
    assert abs(answer / hold / exact - 1.0) < 2e-3


def test_current_sensor_s_twin_does_the_same():
    p = current_sensor_params(50e-6)
    currents = [math.sin(i) for i in range(50)]
    twin = played(p, currents, compiled(current_sensor_step))
    assert twin == pytest.approx(played(p, currents), rel=1e-12)


def test_undamped_mode_is_3600_hz(settings):
    light = settings.transducer._replace(damping=0.0)
    dt = 1e-6
    p = rotor_step_settings(light, dt)
    angle, velocity, crossings, last = 1e-5, 0.0, 0, 1e-5
    for _ in range(100_000):
        angle, velocity = rotor_step(p, angle, velocity, 0.0)
        crossings += angle * last < 0.0
        last = angle
    assert crossings / 2.0 / 0.1 == pytest.approx(3595.0, abs=5.0)
    assert math.hypot(angle, velocity / 22588.0) == pytest.approx(1e-5, rel=1e-3)


@pytest.mark.parametrize("damping", [0.0, 0.01, 0.2, 0.8854377448, 7.2])
@pytest.mark.parametrize("dt", [5e-6, 50e-6, 500e-6])
def test_step_is_the_matrix_exponential(settings, damping, dt):
    t = settings.transducer._replace(damping=damping)
    p = rotor_step_settings(t, dt)
    inertia = t.rotor_inertia
    matrix = numpy.array([[0.0, 1.0], [-t.stiffness / inertia, -damping / inertia]])
    exact = expm(matrix * dt)
    wide = [[p.angle_angle, p.angle_velocity], [p.velocity_angle, p.velocity_velocity]]
    scale = numpy.array([[1.0, 22588.0], [1.0 / 22588.0, 1.0]])  # to comparable sizes
    assert numpy.allclose(wide * scale, exact * scale, rtol=1e-4, atol=1e-6)


def test_static_torque_is_read_in_full(settings):
    p = rotor_step_settings(settings.transducer, 50e-6)
    angle = velocity = 0.0
    for _ in range(2000):
        angle, velocity = rotor_step(p, angle, velocity, 0.35)
    assert settings.transducer.stiffness * angle == pytest.approx(0.35, rel=1e-9)
