# SPDX-License-Identifier: Apache-2.0
"""Screw and rollers are found in the spectrum of a known module."""

from __future__ import annotations

import numpy as np
import pytest
from friction_bench import FakeBench, Module

from screw_module_ros.identification import friction_spectrum
from screw_module_ros.identification.friction_spectrum import Settings, modes, nearest
from screw_module_ros.identification.lab import Lab


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    lab = Lab(FakeBench(Module(noise=0.05)), tmp_path_factory.mktemp("lab"))
    return friction_spectrum.run(lab, Settings())


@pytest.mark.parametrize("way", ["up", "down"])
def test_lines_stand_where_screw_and_rollers_turn(result, way):
    factor = 0.9 + 2.5 * 0.02
    assert result.value(f"screw_{way}") == pytest.approx(20.0 / 19.05, abs=0.06)
    assert result.value(f"rollers_{way}") == pytest.approx(80.0 / 19.05, abs=0.06)
    assert result.value(f"screw_force_{way}") == pytest.approx(1.5 * factor, rel=0.15)
    assert result.value(f"rollers_force_{way}") == pytest.approx(0.4 * factor, rel=0.15)


def test_twice_the_screw_s_rate_is_quiet(result):
    peaks = [friction_spectrum.Peak(*row) for row in result.data["peaks_up"]]
    assert nearest(peaks, 40.0 / 19.05) is None


def test_noise_alone_has_no_lines():
    frequency = np.arange(0.0, 1000.0, 0.056)
    noise = np.abs(np.random.default_rng(2).normal(0.0, 1e-3, len(frequency)))
    assert modes(frequency, noise, 1.05) == []


def test_a_module_without_rollers_is_told_of(tmp_path):
    class Smooth(Module):
        def level(self, z, speed, against):
            return 8.0 + np.sin(2.0 * np.pi * z / 0.01905)

    result = friction_spectrum.run(Lab(FakeBench(Smooth()), tmp_path), Settings())
    assert np.isnan(result.value("rollers_up"))
    assert any("rollers" in note for note in result.notes)
