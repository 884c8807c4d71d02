# SPDX-License-Identifier: Apache-2.0
"""The impedance at the handle: of a known mechanism exactly, of the modes in the right order."""

import math

import numpy as np
import pytest
import yaml

from screw_module_ros.control import modes
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.identification import delivered_impedance
from screw_module_ros.identification.delivered_impedance import FILE, Settings, reduced
from screw_module_ros.identification.in_process import InProcessBench, LoopSettings
from screw_module_ros.identification.lab import Lab
from screw_module_ros.identification.trials import MotionTrial, Samples
from screw_module_ros.plant.settings import load_world


@pytest.mark.parametrize("frequency", [0.5, 4.0, 30.0])
def test_spring_damper_and_mass_are_found(frequency):
    time, omega = np.arange(0.0, 8.0 / frequency + 0.5, 1e-3), 2.0 * math.pi * frequency
    position = 0.01 * np.sin(omega * time + 0.3)
    velocity = 0.01 * omega * np.cos(omega * time + 0.3)
    force = 100.0 * position + 7.0 * velocity - 2.0 * omega**2 * position
    nothing = np.zeros_like(time)
    samples = Samples(time, nothing, nothing, nothing, nothing, nothing, nothing,
                      position, velocity, force)  # fmt: skip
    found = reduced(MotionTrial(modes.OFF, VerticalSettings()), samples, frequency)["impedance"]
    assert complex(found) == pytest.approx(7.0 + 1j * (2.0 * omega - 100.0 / omega), rel=0.01)


def test_observer_is_lighter_than_feedback_and_feedback_than_nothing(tmp_path):
    bench = InProcessBench(load_world(), LoopSettings(rate=1000.0, command_delay=1.2e-3))
    settings = Settings(frequencies=(0.5, 2.0, 4.0, 8.0))
    result = delivered_impedance.run(Lab(bench, tmp_path), settings)
    damping = [result.value(f"damping_{name}") for name in
               ("impedance", "force_feedback", "observer")]  # fmt: skip
    assert damping[0] > 2.0 * damping[1] > 2.0 * damping[2]
    assert result.value("stiffness_observer") == pytest.approx(100.0, abs=15.0)
    certificate = yaml.safe_load((tmp_path / FILE).read_text(encoding="utf-8"))
    assert certificate["delivered"]["mass_observer"]["unit"] == "kg"
    assert "largest_gains" not in certificate, "nobody has looked for them"
