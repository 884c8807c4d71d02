# SPDX-License-Identifier: Apache-2.0
"""Amplifier (thesis 4.1: 60 us, 1 kHz, dead zone, saturation), current sensor and analyser."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from screw_module_ros.compiled import compiled
from screw_module_ros.plant.amplifier import (
    amplifier_step,
    amplifier_step_settings,
    bridge_current,
)
from screw_module_ros.plant.instruments import (
    CurrentSensorState,
    analyzed,
    analyzer_sine,
    current_sensor_params,
    current_sensor_step,
)

RATE = 256_000.0  # of the analyser
TIME_CONSTANT = 1.0 / (2.0 * math.pi * 1000.0)
SQUARE = 1.0 / (19_600.0 * 20_000.0 * 5e-9 * 1.5e-8)  # of the current sensor, thesis C.2
NUMERATOR, DENOMINATOR = [3.42 * SQUARE], [1.0, 39_600.0 * 5e-9 * SQUARE, SQUARE]


def amplified(amplifier, dt, commands):
    """Return (current, mean current) after each command."""
    p, current, past, found = amplifier_step_settings(amplifier, dt), 0.0, (0.0, 0.0, 0.0), []
    for command in commands:
        current, mean = amplifier_step(p, current, command, *past)
        past = (command, *past[:2])
        found.append((current, mean))
    return found


def sensed(dt, currents, step=current_sensor_step):
    """Return the current sensor's output after each current, held for a substep [V]."""
    p, state, volts = current_sensor_params(dt), CurrentSensorState(), []
    for current in currents:
        out, state = step(p, state, current, 0.0)
        volts.append(out)
    return volts


def sine(frequency, dt):
    """Return twenty periods, for `answer`, which takes the second half."""
    count = 2 * round(10.0 / frequency / dt)
    return [math.sin(2.0 * math.pi * frequency * i * dt) for i in range(count)]


def answer(outputs, frequency, dt):
    """Return the gain from a held sine to the output; output i is that of time (i + 1) dt."""
    half = math.pi * frequency * dt
    number = np.arange(len(outputs) // 2, len(outputs))  # settled
    turned = np.asarray(outputs)[number] * np.exp(-2j * half * (number + 1))
    hold = cmath.exp(-1j * half) * math.sin(half) / half
    return turned.mean() * 2j / hold


def amplifier_answer(frequency):
    omega = 2.0 * math.pi * frequency
    return cmath.exp(-1j * omega * 60e-6) / (1.0 + 1j * omega * TIME_CONSTANT)


@pytest.mark.parametrize("dt", [25e-6, 40e-6, 50e-6, 100e-6])
def test_step_response_is_delay_then_pole(settings, dt):
    for number, (current, _) in enumerate(amplified(settings.amplifier, dt, [1.0] * 29), 1):
        since = number * dt - 60e-6
        expected = 0.0 if since <= 0.0 else 1.0 - math.exp(-since / TIME_CONSTANT)
        assert current == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("frequency", [10.0, 200.0, 1000.0, 3000.0])
def test_frequency_response(settings, frequency):
    currents = [now for now, _ in amplified(settings.amplifier, 25e-6, sine(frequency, 25e-6))]
    assert abs(answer(currents, frequency, 25e-6) / amplifier_answer(frequency) - 1.0) < 0.01


def test_mean_current_does_not_depend_on_the_substep(settings):
    commands = [math.sin(i) * 5.0 for i in range(40)]
    coarse = amplified(settings.amplifier, 50e-6, commands)
    fine = amplified(settings.amplifier, 25e-6, [each for each in commands for _ in (1, 2)])
    for (current, mean), (_, first), (last, second) in zip(
        coarse, fine[::2], fine[1::2], strict=True
    ):
        assert (current, mean) == pytest.approx((last, (first + second) / 2.0), abs=1e-12)


@pytest.mark.parametrize(
    ("asked", "low", "high"),
    [
        (0.005, 0.0, 0.001),
        (0.0125, 0.0, 0.004),
        (0.4, 0.375 - 1e-6, 0.375 + 1e-6),
        (-0.4, -0.375 - 1e-6, -0.375 + 1e-6),
        (0.0, 0.0, 0.0),
    ],
)
def test_dead_zone_of_25_mnm(settings, asked, low, high):
    a = settings.amplifier
    assert low <= a.torque_constant * bridge_current(a, asked / a.torque_constant) <= high


def test_saturation_at_ten_amperes(settings):
    a = settings.amplifier
    assert bridge_current(a, 1e6) == bridge_current(a, 10.0) <= 10.0
    assert bridge_current(a, -1e6) == -bridge_current(a, 10.0)


@given(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0))
def test_more_command_never_gives_less_current(settings, one, other):
    low, high = sorted((one, other))
    assert bridge_current(settings.amplifier, low) <= bridge_current(settings.amplifier, high)


def test_no_dead_zone_is_the_identity(settings):
    assert bridge_current(settings.amplifier._replace(dead_zone=0.0), 0.01) == 0.01


def test_substep_too_short_for_the_delay_is_refused(settings):
    with pytest.raises(ValueError, match="substep"):
        amplifier_step_settings(settings.amplifier, 10e-6)


# The signal analyser plays a sine into the amplifier alone.


@pytest.fixture
def linear(settings):
    return settings.amplifier._replace(dead_zone=0.0)


def test_the_analyser_s_command_is_the_sine(linear):
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
    _, current = analyzed(linear, frequency, 2.2, 0.02 + 1.0 / RATE, RATE)
    found = answer(current[1:], frequency, 1.0 / RATE) / 2.2
    assert abs(found / amplifier_answer(frequency) - 1.0) < 0.01


def test_the_analyser_sees_the_dead_zone(settings):
    _, current = analyzed(settings.amplifier, 10.0, 2.2, 0.2, RATE)
    assert current.max() == pytest.approx(bridge_current(settings.amplifier, 2.2), rel=1e-3)
    assert current.max() < 2.06


@pytest.mark.parametrize("dt", [25e-6, 50e-6, 500e-6])
def test_current_sensor_s_step_response_is_exact(dt):
    _, exact = signal.step((NUMERATOR, DENOMINATOR), T=[n * dt for n in range(40)])
    assert sensed(dt, [1.0] * 39) == pytest.approx(exact[1:], abs=1e-6)


@pytest.mark.parametrize("dt", [25e-6, 50e-6, 500e-6])
def test_current_sensor_s_answer_to_a_line_is_exact(dt):
    """A current that rises evenly: its mean and its change are given for each substep."""
    time = [n * dt for n in range(40)]
    _, exact, _ = signal.lsim((NUMERATOR, DENOMINATOR), [1e3 * t for t in time], time)
    p, state, volts = current_sensor_params(dt), CurrentSensorState(), []
    for t in time[:-1]:
        out, state = current_sensor_step(p, state, 1e3 * (t + 0.5 * dt), 1e3 * dt)
        volts.append(out)
    assert volts == pytest.approx(exact[1:], rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("frequency", [20.0, 200.0, 1000.0])
def test_current_sensor_s_frequency_response(frequency):
    s = 2j * math.pi * frequency
    exact = NUMERATOR[0] / (s * s + DENOMINATOR[1] * s + SQUARE)
    found = answer(sensed(50e-6, sine(frequency, 50e-6)), frequency, 50e-6)
    assert abs(found / exact - 1.0) < 2e-3


def test_plain_and_compiled_agree(settings):
    given = (settings.amplifier, 777.0, 2.2, 0.002, RATE)
    for plain, twin in zip(analyzer_sine(*given), analyzed(*given), strict=True):
        assert plain == pytest.approx(twin, abs=1e-12)
    currents = [math.sin(i) for i in range(50)]
    twin = sensed(50e-6, currents, compiled(current_sensor_step))
    assert twin == pytest.approx(sensed(50e-6, currents), rel=1e-12)
