# SPDX-License-Identifier: Apache-2.0
"""Pole and delay of a known amplifier are found again from a swept sine (thesis 4.1.2)."""

from __future__ import annotations

import numpy as np
import pytest

from screw_module_ros.identification import amplifier_response
from screw_module_ros.identification.amplifier_response import Settings
from screw_module_ros.identification.lab import Lab
from screw_module_ros.identification.sampled import first_order, sampled_response
from screw_module_ros.identification.trials import WAYS_OUT, Samples

FEW = Settings(low=100.0, per_decade=8, shortest=0.02)


class FakeBench:
    """An amplifier without a dead zone, with a pole and a delay of its own, and noise."""

    rate, name, serial, offers = 2000.0, "fake", "", frozenset(WAYS_OUT)

    def __init__(self, pole=800.0, delay=85e-6, noise=0.02):
        self.pole, self.delay, self.noise = pole, delay, noise
        self.asked = []

    def record(self, trial, told):
        self.asked.append(trial)
        time = np.arange(round(trial.duration * trial.rate)) / trial.rate
        turn = np.exp(2j * np.pi * trial.frequency * time)
        answer = sampled_response(
            first_order(self.pole), np.array([trial.frequency]), trial.rate, self.delay
        )[0]
        draw = np.random.default_rng(len(self.asked))
        current = (trial.amplitude * answer * turn).imag + draw.normal(0.0, self.noise, time.size)
        nothing = np.full_like(time, np.nan)
        command = trial.amplitude * turn.imag
        return Samples(time, nothing, nothing, nothing, nothing, command, current)


def test_pole_and_delay_with_honest_errors(tmp_path):
    result = amplifier_response.run(Lab(FakeBench(), tmp_path), FEW)
    for name, truth in (("pole", 800.0), ("delay", 85e-6), ("gain", 1.0)):
        found = result.quantity(name)
        assert found.value == pytest.approx(truth, rel=0.01)
        assert abs(found.value - truth) < 4.0 * found.uncertainty


def test_forty_frequencies_a_decade_of_whole_cycles(tmp_path):
    bench = FakeBench()
    result = amplifier_response.run(Lab(bench, tmp_path), Settings(low=1000.0, shortest=0.005))
    assert len(bench.asked) == 41
    cycles = [(trial.duration - 0.01) * trial.frequency for trial in bench.asked]
    assert cycles == pytest.approx(np.round(cycles), abs=1e-6)
    assert np.abs(result.data["model"] / result.data["measured"] - 1.0).max() < 0.05
    assert result.data["frequency"][[0, -1]] == pytest.approx([1000.0, 10_000.0])
