# SPDX-License-Identifier: Apache-2.0
"""Amplifier: 60 us and 1 kHz, dead zone, saturation (thesis 4.1)."""

from __future__ import annotations

import cmath
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.plant.amplifier import (
    amplifier_step,
    amplifier_step_settings,
    bridge_current,
)

TIME_CONSTANT = 1.0 / (2.0 * math.pi * 1000.0)


class Chain:
    """An amplifier in time, from the pure step."""

    def __init__(self, amplifier, dt):
        self.p = amplifier_step_settings(amplifier, dt)
        self.current, self.mean, self.past = 0.0, 0.0, (0.0, 0.0, 0.0)

    def step(self, command):
        self.current, self.mean = amplifier_step(self.p, self.current, command, *self.past)
        self.past = (command, *self.past[:2])
        return self.current


@pytest.mark.parametrize("dt", [25e-6, 40e-6, 50e-6, 100e-6])
def test_step_response_is_delay_then_pole(settings, dt):
    chain = Chain(settings.amplifier, dt)
    for number in range(1, 30):
        since = number * dt - 60e-6
        expected = 0.0 if since <= 0.0 else 1.0 - math.exp(-since / TIME_CONSTANT)
        assert chain.step(1.0) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("frequency", [10.0, 200.0, 1000.0, 3000.0])
def test_frequency_response(settings, frequency):
    dt = 25e-6
    chain = Chain(settings.amplifier, dt)
    count = round(20.0 / frequency / dt)
    omega = 2.0 * math.pi * frequency
    answer = 0.0
    for i in range(2 * count):
        current = chain.step(math.sin(omega * i * dt))
        if i >= count:  # settled; current is that of time (i + 1) dt
            answer += current * cmath.exp(-1j * omega * (i + 1) * dt) * 2j / count
    hold = cmath.exp(-0.5j * omega * dt) * math.sin(omega * dt / 2) / (omega * dt / 2)
    amplifier = cmath.exp(-1j * omega * 60e-6) / (1.0 + 1j * omega * TIME_CONSTANT)
    assert abs(answer / hold / amplifier - 1.0) < 0.01


def test_mean_current_does_not_depend_on_the_substep(settings):
    coarse, fine = Chain(settings.amplifier, 50e-6), Chain(settings.amplifier, 25e-6)
    for i in range(40):
        command = math.sin(i) * 5.0
        coarse.step(command)
        fine.step(command)
        first = fine.mean
        fine.step(command)
        assert coarse.mean == pytest.approx((first + fine.mean) / 2.0, abs=1e-12)
        assert coarse.current == pytest.approx(fine.current, abs=1e-12)


def test_dead_zone_of_25_mnm(settings):
    a = settings.amplifier

    def torque(asked):
        return a.torque_constant * bridge_current(a, asked / a.torque_constant)

    assert torque(0.005) < 0.2 * 0.005
    assert torque(0.0125) < 0.004
    assert torque(0.4) == pytest.approx(0.375, abs=1e-6)
    assert torque(-0.4) == pytest.approx(-0.375, abs=1e-6)
    assert torque(0.0) == 0.0


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
