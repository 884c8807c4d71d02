# SPDX-License-Identifier: Apache-2.0
"""The mass of a known module is found, by the ratio and by regression."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from friction_bench import FakeBench, Module

from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.identification import friction_model, inertia
from screw_module_ros.identification.friction_model import friction_along
from screw_module_ros.identification.inertia import Motion, Settings, motion, ratio
from screw_module_ros.identification.lab import Lab
from screw_module_ros.identification.results import Result

THESIS = thesis_friction()
SHORT = Settings(duration=4.0)


class Thesis(FakeBench):
    """Friction and weight of the thesis's model, times `share`, and a force that comes late."""

    share = 1.0
    late = 0

    def _motion(self, trial):
        time, z, force = super()._motion(trial)
        v = trial.amplitude * trial.omega * np.cos(trial.omega * time)
        a = -trial.amplitude * trial.omega**2 * np.sin(trial.omega * time)
        friction = self.share * friction_along(THESIS._replace(fastest_mm_s=2000.0), z, v)
        force = self.module.mass * a + friction + THESIS.gravity_N
        return time, z, np.roll(force, self.late)


def keep_model(folder: Path) -> None:
    data = friction_model._as_data(THESIS)
    Result(friction_model.NAME, (), {}, (), data).save(folder)


def identified(folder, settings=SHORT, mass=5.49, share=1.0):
    keep_model(folder)
    bench = Thesis(Module(mass=mass, noise=0.05))
    bench.share = share
    return inertia.run(Lab(bench, folder), settings)


@pytest.mark.parametrize("mass", [4.7, 6.4])
def test_both_methods_find_the_mass(tmp_path, mass):
    result = identified(tmp_path, mass=mass)
    assert result.value("mass") == pytest.approx(mass, rel=0.01)
    assert result.value("mass_thesis_strict") == pytest.approx(mass, rel=0.02)
    assert abs(result.value("shift")) <= 0.003
    assert 0.0 < result.quantity("mass").uncertainty < 0.1


def test_with_a_friction_model_that_is_a_fifth_short_the_mass_stays_within_a_tenth(tmp_path):
    result = identified(tmp_path, share=1.25)
    assert result.value("mass") == pytest.approx(5.49, rel=0.1)
    assert result.value("coulomb_left") + 0.5 * result.value("viscous_left") > 1.0


def test_near_zero_acceleration_the_ratio_as_printed_is_worthless(tmp_path):
    result = identified(tmp_path, share=1.25)
    strict, printed = result.quantity("mass_thesis_strict"), result.quantity("mass_thesis")
    assert printed.uncertainty > 3.0 * strict.uncertainty
    assert any("standard deviation" in note for note in result.notes)


def test_the_shift_finds_a_force_that_comes_late():
    bench = Thesis(Module(noise=0.0))
    bench.late = 16  # 8 ms, as in fig 5-33
    samples = bench.record(list(inertia._trials(SHORT).values())[2], None)
    record = motion(samples.time, samples.position, samples.force)
    model = THESIS._replace(fastest_mm_s=2000.0)
    friction = friction_along(model, record.position, record.velocity)
    found = ratio(record, record.force - np.roll(friction, 16) - THESIS.gravity_N, 0.02, 2.5, 0.03)
    assert found.shift == pytest.approx(0.008, abs=0.001)
    assert np.nanmean(found.mass) == pytest.approx(5.49, rel=0.01)


def test_velocity_and_acceleration_have_no_delay():
    time = np.arange(6000) / 2000.0
    record = motion(time, 0.1 * np.sin(6.0 * time), np.zeros(6000))
    assert record.velocity == pytest.approx(0.6 * np.cos(6.0 * record.time), abs=2e-3)
    assert record.acceleration == pytest.approx(-3.6 * np.sin(6.0 * record.time), abs=2e-2)


def test_slow_and_unaccelerated_samples_are_left_out():
    velocity = np.array([0.019, 0.02, -0.5, 0.5])
    acceleration = np.array([3.0, 3.0, -3.0, 0.002])
    record = Motion(np.arange(4.0), velocity, velocity, acceleration, velocity, velocity)
    found = ratio(record, 5.0 * acceleration, 0.02, 0.0025, 0.0)
    assert np.isfinite(found.mass).tolist() == [False, True, True, False]


def test_a_handle_that_hardly_moves_tells_no_mass(tmp_path):
    settings = SHORT._replace(amplitudes=(0.005,), omegas=(1.0,))
    with pytest.raises(ValueError, match="fast enough"):
        identified(tmp_path, settings)
