# SPDX-License-Identifier: Apache-2.0
"""What a motor by formulas hides is found: dead zone, pole, damping, delays (thesis 4.1)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from formula_stand import FormulaBench, Motor, keep, keep_line

from screw_module_ros.control.linearization import default_linearization, torque_command
from screw_module_ros.identification.experiments import EXPERIMENTS
from screw_module_ros.identification.lab import Lab
from screw_module_ros.identification.results import load_result
from screw_module_ros.identification.static_torque import (
    commands,
    desired_torque,
    linearization_of,
)

FEW = {"count": 8, "low": 5.0}
SOFT = Motor(gain=0.95, dead=0.03, delay=1.2e-3)
DELAY = 280e-6, 0.018


def found(folder, name, motor, **settings):
    """Run an experiment on a motor; return its result and the stand."""
    stand = FormulaBench(motor=motor)
    chosen = EXPERIMENTS[name].settings()._replace(**settings)
    return EXPERIMENTS[name].run(Lab(stand, folder), chosen), stand


@pytest.mark.parametrize(
    ("name", "settings", "motor", "hidden", "said"),
    [
        ("static_torque", {}, SOFT,
         {"torque_constant": (0.16 * 0.95, 0.003), "dead_zone": (0.95 * 0.03, 0.02)}, ""),
        ("amplifier_response", {"low": 100.0, "per_decade": 8, "shortest": 0.02},
         Motor(pole=800.0, lag=85e-6, noise=0.002),
         {"pole": (800.0, 0.01), "delay": (85e-6, 0.01), "gain": (1.0, 0.01)}, ""),
        ("current_response", FEW, Motor(), {"delay": DELAY, "gain": (1.0, 0.01)},
         "as in the settings: 1000 Hz, 60 us"),
        ("torque_response", FEW, Motor(),
         {"delay": DELAY, "delay_slow": DELAY, "damping": (5.0, 0.02),
          "damping_slow": (5.0, 0.02)}, ""),
        ("torque_response", {**FEW, "count": 12, "slow_rate": 0.0},
         Motor(damping=0.1, noise=0.0003), {"damping": (0.1, 0.2)}, "The mode resonates"),
    ],
)  # fmt: skip
def test_what_the_motor_hides_is_found_with_an_honest_error(
    tmp_path, name, settings, motor, hidden, said
):
    keep_line(tmp_path)
    result, _ = found(tmp_path, name, motor, **settings)
    for quantity, (truth, share) in hidden.items():
        value = result.quantity(quantity)
        assert value.value == pytest.approx(truth, rel=share), quantity
        assert abs(value.value - truth) < 4.0 * value.uncertainty < 0.25 * truth, quantity
    assert said in " ".join(result.notes)


@pytest.mark.parametrize("delay", [0.4e-3, 1.1e-3, 2.6e-3])
def test_the_whole_delay_of_a_loop_is_found(tmp_path, delay):
    """Also one of several periods, and where the amplifier is another one than assumed: what the
    software's delay loses there is the amplifier's."""
    keep_line(tmp_path)
    result, _ = found(tmp_path, "torque_response", Motor(delay=delay, lag=110e-6), **FEW)
    loop = result.quantity("loop_delay")
    truth = delay + 110e-6 + 1.0 / (2.0 * math.pi * 1000.0)
    assert loop.value == pytest.approx(truth, abs=8e-6)
    assert result.value("delay") == pytest.approx(delay + 50e-6, abs=8e-6)


def test_the_measured_amplifier_is_used(tmp_path):
    """With an assumed amplifier delay 50 us longer, the software delay is 50 us shorter."""
    keep_line(tmp_path)
    keep(tmp_path, "amplifier_response", pole=1000.0, delay=110e-6)
    result, _ = found(tmp_path, "current_response", Motor(), **FEW)
    assert result.value("delay") == pytest.approx(230e-6, abs=5e-6)
    assert "as measured" in result.notes[0]


def test_forty_frequencies_a_decade_of_whole_cycles(tmp_path):
    result, stand = found(tmp_path, "amplifier_response", Motor(), low=1000.0, shortest=0.005)
    cycles = [(trial.duration - 0.01) * trial.frequency for trial in stand.asked]
    assert len(cycles) == 41 and cycles == pytest.approx(np.round(cycles), abs=1e-6)
    assert result.data["frequency"][[0, -1]] == pytest.approx([1000.0, 10_000.0])


def test_known_dynamics_tell_the_delay_and_a_wire_does_not(tmp_path):
    """Thesis 4.1.4; the resonance, at 3595 Hz, folds to 405 Hz (4.1.3 has 3600 and 400)."""
    keep_line(tmp_path)
    result, _ = found(tmp_path, "torque_response", Motor(), **FEW)
    assert result.value("resonance_seen") == pytest.approx(405.0, abs=1.0)
    light = np.abs(result.data["folded_light"])
    assert result.data["folded_frequency"][light.argmax()] == pytest.approx(405.0, abs=10.0)
    delays, rotor, wire = (result.data[f"limit_{name}"] for name in ("delay", "rotor", "wire"))
    assert delays[rotor.argmin()] == pytest.approx(280e-6, abs=6e-6)
    assert rotor[delays < 200e-6].min() > 5.0 * rotor.min()
    assert np.ptp(wire[(delays > 0.0) & (delays < 430e-6)]) < 1e-9
    assert wire[delays > 450e-6].min() > 0.1


def test_the_map_undoes_the_amplifier(tmp_path):
    found(tmp_path, "static_torque", SOFT)[0].save(tmp_path)
    result = load_result(tmp_path, "static_torque")
    assert result.value("correlation") >= 0.9999 > 0.9995 > result.value("correlation_raw")
    left, at_handle = result.value("largest_left"), result.value("largest_at_handle")
    assert left < 0.005 and at_handle == pytest.approx(left * 2.0 * np.pi / 0.01905)
    assert result.value("slope") == pytest.approx(1.0, abs=0.002)
    for torque in (-0.3, -0.1, -0.03, -0.01, 0.01, 0.03, 0.1, 0.3):
        command = torque_command(linearization_of(result), torque)
        assert SOFT.torque(command) == pytest.approx(torque, abs=0.002)


def test_desired_torque_is_the_inverse_of_the_map():
    torque, line = np.linspace(-0.4, 0.4, 1001), default_linearization()
    assert desired_torque(line, commands(line, torque)) == pytest.approx(torque, abs=1e-6)
