# SPDX-License-Identifier: Apache-2.0
"""Current sensor: 3.42 V/A, second order at 928.8 Hz, exact at any substep (thesis C.2)."""

from __future__ import annotations

import cmath
import math

import pytest
from scipy import signal

from screw_module_ros.compiled import compiled
from screw_module_ros.plant.instruments import (
    CurrentSensorState,
    current_sensor_params,
    current_sensor_step,
)

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
def test_step_response_is_exact(dt):
    times = [n * dt for n in range(40)]
    _, exact = signal.step((NUMERATOR, DENOMINATOR), T=times)
    assert played(current_sensor_params(dt), [1.0] * 39) == pytest.approx(exact[1:], abs=1e-6)


def test_settles_at_3_42_volts_per_ampere():
    assert played(current_sensor_params(50e-6), [2.0] * 400)[-1] == pytest.approx(6.84, rel=1e-9)


@pytest.mark.parametrize("frequency", [20.0, 200.0, 1000.0])
def test_frequency_response(frequency):
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


def test_compiled_twin_does_the_same():
    p = current_sensor_params(50e-6)
    currents = [math.sin(i) for i in range(50)]
    twin = played(p, currents, compiled(current_sensor_step))
    assert twin == pytest.approx(played(p, currents), rel=1e-12)
