# SPDX-License-Identifier: Apache-2.0
"""The impedance at the handle: of a known mechanism exactly, of the modes in the right order."""

import hashlib
import math
from types import MappingProxyType

import numpy as np
import pytest
import yaml
from formula_stand import keep

from screw_module_ros.control import modes
from screw_module_ros.control.laws import LAWS
from screw_module_ros.control.vertical_settings import KNOWN_SHARE, VerticalSettings
from screw_module_ros.identification import delivered_impedance
from screw_module_ros.identification.calibration import GAIN_LIMITS as FILE
from screw_module_ros.identification.delivered_impedance import (
    Settings,
    _followed,
    reduced,
)
from screw_module_ros.identification.force_metric import friction_felt
from screw_module_ros.identification.lab import Lab
from screw_module_ros.identification.stand import LoopSettings, SimulatedStand
from screw_module_ros.identification.trials import WAYS_OUT, MotionTrial, NotPossible, Samples


def impedance(hertz, amplitude, force_of, phase=0.0):
    """Return what is found of a mechanism: force_of(position, velocity, acceleration)."""
    omega = 2.0 * math.pi * hertz
    angle = omega * np.arange(0.0, 8.0 / hertz + 0.5, 1e-3) + phase
    position = amplitude * np.sin(angle)
    velocity = amplitude * omega * np.cos(angle)
    nothing = np.zeros_like(angle)
    force = force_of(position, velocity, -(omega**2) * position)
    samples = Samples(np.arange(len(angle)) * 1e-3, *([nothing] * 6), position, velocity, force)
    trial = MotionTrial(modes.OFF, VerticalSettings(), omega=omega)
    return complex(reduced(trial, samples)["impedance"])


@pytest.mark.parametrize("hertz", [0.5, 4.0, 30.0])
def test_spring_damper_and_mass_are_found(hertz):
    found = impedance(hertz, 0.01, lambda x, v, a: 100.0 * x + 7.0 * v + 2.0 * a, 0.3)
    omega = 2.0 * math.pi * hertz
    assert found == pytest.approx(7.0 + 1j * (2.0 * omega - 100.0 / omega), rel=0.01)


def test_coulomb_friction_is_found_beside_a_damper():
    found = impedance(0.5, 0.04, lambda x, v, a: 6.0 * np.sign(v) + 5.0 * v)
    assert friction_felt(found.real, 5.0, 0.04 * math.pi) == pytest.approx(6.0, rel=0.01)


@pytest.mark.parametrize("amplitude", [0.002, 0.0])
def test_a_hand_that_cannot_follow_the_sine_is_told(amplitude):
    """On hardware a person was asked for 30 Hz; the file showed noise over noise."""
    time = np.arange(0.0, 0.8, 1e-3)
    slow = amplitude * np.sin(2.0 * math.pi * 1.3 * time)
    trial = MotionTrial(modes.OFF, VerticalSettings(), omega=2.0 * math.pi * 30.0)
    found = reduced(trial, Samples(time, slow, *([np.ones_like(time)] * 5)))
    assert np.isnan(found["impedance"])


def test_a_frequency_that_the_hand_did_not_follow_is_left_out_and_said():
    hertz, z = np.array([0.5, 4.0, 30.0]), np.array([9.0 - 30j, 8.0 + 20j, math.nan])
    there, found, (note,) = _followed("observer", hertz, z)
    assert list(there) == [0.5, 4.0] and list(found) == list(z[:2])
    assert "30 Hz in observer" in note
    with pytest.raises(ValueError, match="no sine from 4 Hz .not those of 4, 30 Hz"):
        _followed("observer", hertz, np.array([9.0 - 30j, math.nan, math.nan]))


def test_observer_is_lighter_than_feedback_and_feedback_than_nothing(tmp_path, module):
    stand = SimulatedStand(module, LoopSettings(rate=1000.0, command_delay=1.2e-3))
    settings = Settings(frequencies=(0.5, 2.0, 4.0, 8.0))
    result = delivered_impedance.run(Lab(stand, tmp_path), settings)
    damping, friction, hold, release, wall = (
        [result.value(f"{what}_{name}") for name in ("impedance", "force_feedback", "observer")]
        for what in ("damping", "friction", "hold", "release", "wall")
    )
    assert damping[0] > 2.0 * damping[1] > 2.0 * damping[2]
    assert 5.0 < friction[0] < 15.0, "about the 9 N of the thesis's map there"
    assert friction[0] > 3.0 * friction[1] > 3.0 * abs(friction[2])
    assert hold[2] < 0.3 < hold[0]
    assert release[2] < 0.3 < release[0]
    assert wall[0] > wall[1] > wall[2] and wall[2] < 0.8
    assert result.value("stiffness_observer") == pytest.approx(100.0, abs=15.0)
    assert set(delivered_impedance.draw(result)) == {"impedance", "at rest"}
    text = (tmp_path / FILE).read_text(encoding="utf-8")
    limits = yaml.safe_load(text)
    assert limits["delivered"]["mass_observer"]["unit"] == "kg"
    assert limits["delivered"]["hold_travel_observer"]["value"] < 0.2e-3
    assert "largest_gains" not in limits, "nobody has looked for them"
    assert limits["serial"] == "SIM-0001"
    body, checksum = text.split("sha256: ")
    assert checksum.strip() == hashlib.sha256(body.encode()).hexdigest()


def test_it_is_of_the_law_that_the_calibration_makes(tmp_path):
    """Beside gains for the identified mass stood the impedance of the default law."""

    class Asked:
        rate, name, serial, offers = 1000.0, "asked", "", frozenset(WAYS_OUT)
        laws, law_settings = LAWS, MappingProxyType({})

        def record(self, trial, told):
            assert (trial.settings.gravity, trial.settings.mass) == (8.7, 5.1)
            assert trial.settings.observer_inertia == KNOWN_SHARE
            raise NotPossible("asked for the right law")

    keep(tmp_path, "gravity", gravity=8.7)
    keep(tmp_path, "inertia", mass=5.1)
    with pytest.raises(NotPossible, match="asked for the right law"):
        delivered_impedance.run(Lab(Asked(), tmp_path), Settings())
