# SPDX-License-Identifier: Apache-2.0
"""Dead zone, torque constant and linearization of a known amplifier are found again (4.1.1)."""

from __future__ import annotations

import math

import numpy as np
import pytest

from screw_module_ros.control.linearization import IDENTITY, default_linearization, torque_command
from screw_module_ros.identification import static_torque
from screw_module_ros.identification.lab import Lab
from screw_module_ros.identification.results import load_result
from screw_module_ros.identification.static_torque import (
    Settings,
    commands,
    desired_torque,
    fit_pieces,
    linearization_of,
)
from screw_module_ros.identification.trials import WAYS_OUT, Samples

DEAD, SHARPNESS = 0.03, 0.8
LAG = 3  # samples from command to torque


class FakeBench:
    """A motor with `gain` Nm of torque for a Nm of command beyond a soft dead zone, and noise."""

    rate, name, serial, offers = 2000.0, "fake", "", frozenset(WAYS_OUT)

    def __init__(self, gain=0.95, noise=0.0012):
        self.gain, self.noise = gain, noise

    def record(self, trial, told):
        time = np.arange(round(trial.duration * self.rate)) / self.rate
        command = trial.amplitude * np.sin(2.0 * math.pi * trial.frequency * time)
        command = commands(trial.linearization or IDENTITY, command)
        late = np.concatenate([np.zeros(LAG), command[:-LAG]])
        torque = self.gain * (late - DEAD * np.tanh(SHARPNESS * late / DEAD))
        torque += np.random.default_rng(5).normal(0.0, self.noise, len(time))
        nothing = np.full_like(time, np.nan)
        return Samples(time, nothing, nothing, nothing, torque, command, nothing)


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab")
    result = static_torque.run(Lab(FakeBench(), folder), Settings())
    result.save(folder)
    return load_result(folder, static_torque.NAME)


def test_torque_constant_and_dead_zone(result):
    constant, dead = result.quantity("torque_constant"), result.quantity("dead_zone")
    assert constant.value == pytest.approx(0.16 * 0.95, rel=0.003)
    assert dead.value == pytest.approx(0.95 * DEAD, rel=0.02)
    assert abs(constant.value - 0.152) < 4.0 * constant.uncertainty < 0.002
    assert abs(dead.value - 0.95 * DEAD) < 4.0 * dead.uncertainty < 0.002


def test_linearized_torque_is_a_line(result):
    assert result.value("correlation") >= 0.9999
    assert result.value("correlation_raw") < 0.9995
    assert result.value("largest_left") < 0.005
    per_torque = 2.0 * math.pi / 0.01905
    at_handle = result.value("largest_at_handle")
    assert at_handle == pytest.approx(result.value("largest_left") * per_torque)
    assert result.value("slope") == pytest.approx(1.0, abs=0.002)


def test_the_map_undoes_the_amplifier(result):
    found = linearization_of(result)
    for torque in (-0.3, -0.1, -0.03, -0.01, 0.01, 0.03, 0.1, 0.3):
        command = torque_command(found, torque)
        yielded = 0.95 * (command - DEAD * math.tanh(SHARPNESS * command / DEAD))
        assert yielded == pytest.approx(torque, abs=0.002)


def test_three_pieces_are_found_again():
    truth = default_linearization()
    torque = 0.3 * np.sin(np.linspace(0.0, 2.0 * np.pi, 4000))
    draw = np.random.default_rng(2)
    command = commands(truth, torque) + draw.normal(0.0, 1e-4, torque.size)
    found = fit_pieces(torque, command)
    joints, lower, middle, upper = found.linearization
    assert joints == pytest.approx(truth.joints_Nm, abs=2e-4)
    for line, true in ((lower, truth.lower), (upper, truth.upper)):
        assert line.offset_Nm == pytest.approx(true.offset_Nm, abs=2e-4)
    assert upper.slope == pytest.approx(1.0, abs=1e-3)
    assert middle[0] == pytest.approx(truth.middle[0], rel=0.03)
    assert abs(joints[1] - 0.025) < 4.0 * found.joint_errors[1] < 1e-3


def test_desired_torque_is_the_inverse_of_the_map():
    torque = np.linspace(-0.4, 0.4, 1001)
    truth = default_linearization()
    assert desired_torque(truth, commands(truth, torque)) == pytest.approx(torque, abs=1e-6)
