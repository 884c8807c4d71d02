# SPDX-License-Identifier: Apache-2.0
"""Damping and delay of a known rotor are found again; what a wire hides (thesis 4.1.3, 4.1.4)."""

from __future__ import annotations

import numpy as np
import pytest
from sampled_bench import SampledBench, keep_linearization

from screw_module_ros.identification import torque_response
from screw_module_ros.identification.lab import Lab
from screw_module_ros.identification.torque_response import Settings

FEW = Settings(count=12, low=5.0)


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab")
    keep_linearization(folder)
    return torque_response.run(Lab(SampledBench(damping=5.0, delay=280e-6), folder), FEW)


@pytest.mark.parametrize("end", ["", "_slow"])
def test_damping_and_delay_with_honest_errors(result, end):
    damping, delay = result.quantity(f"damping{end}"), result.quantity(f"delay{end}")
    assert damping.value == pytest.approx(5.0, rel=0.02)
    assert delay.value == pytest.approx(280e-6, abs=5e-6)
    assert abs(damping.value - 5.0) < 4.0 * damping.uncertainty
    assert abs(delay.value - 280e-6) < 4.0 * delay.uncertainty


def test_light_damping_is_not_taken_for_heavy(tmp_path):
    keep_linearization(tmp_path)
    bench = SampledBench(damping=0.1, noise=0.0003)
    result = torque_response.run(Lab(bench, tmp_path), FEW._replace(slow_rate=0.0))
    assert result.value("damping") == pytest.approx(0.1, rel=0.2)
    assert "The mode resonates" in result.notes[1]


def test_resonance_folds_to_405_hz(result):
    light = np.abs(result.data["folded_light"])
    assert result.value("resonance") == pytest.approx(3595.0, abs=1.0)
    assert result.value("resonance_seen") == pytest.approx(405.0, abs=1.0)
    assert result.data["folded_frequency"][light.argmax()] == pytest.approx(405.0, abs=10.0)


def test_known_dynamics_tell_the_delay_and_a_wire_does_not(result):
    delays, rotor, wire = (result.data[f"limit_{name}"] for name in ("delay", "rotor", "wire"))
    assert delays[rotor.argmin()] == pytest.approx(280e-6, abs=6e-6)
    assert rotor[delays < 200e-6].min() > 5.0 * rotor.min()
    same = (delays > 0.0) & (delays < 430e-6)
    assert np.ptp(wire[same]) < 1e-9
    assert wire[delays > 450e-6].min() > 0.1


def test_what_is_read_behind_a_short_delay_is_a_whole_sample_late(result):
    """Figure 4-14; the lines have 100 points to a sample."""
    axes = torque_response.draw(result)["4-14"].axes[0]
    lines = {line.get_label(): line.get_ydata() for line in axes.lines}
    assert lines["read, held again"][100:] == pytest.approx(lines["input, held"][:-100])
