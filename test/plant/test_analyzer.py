# SPDX-License-Identifier: Apache-2.0
"""Analyser on the amplifier alone: 60 us and 1 kHz seen at 256 kHz (thesis 4.1.2)."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest

from screw_module_ros.plant.amplifier import bridge_current
from screw_module_ros.plant.instruments import analyzed, analyzer_sine

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
def test_frequency_response(linear, frequency):
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
