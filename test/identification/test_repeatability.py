# SPDX-License-Identifier: Apache-2.0
"""Two runs of a known module differ by its noise, or by what changed between them."""

from __future__ import annotations

import pytest
from friction_bench import FakeBench, Module

from screw_module_ros.identification import repeatability
from screw_module_ros.identification.lab import Lab
from screw_module_ros.identification.repeatability import Settings


class Worn(FakeBench):
    """A module whose friction grows from one run to the next."""

    def record(self, trial, told):
        self.module = self.module._replace(friction=self.module.friction + 0.5)
        return super().record(trial, told)


def test_runs_of_one_module_differ_by_noise(tmp_path):
    result = repeatability.run(Lab(FakeBench(Module(noise=0.1)), tmp_path), Settings())
    for way in ("up", "down"):
        noise = result.value(f"noise_{way}")
        assert result.value(f"deviation_{way}") == pytest.approx(noise, rel=0.4)
        assert abs(result.value(f"difference_{way}")) < 0.01


def test_a_change_between_runs_is_seen(tmp_path):
    result = repeatability.run(Lab(Worn(Module()), tmp_path), Settings())
    assert result.value("difference_up") == pytest.approx(0.5 * (0.9 + 2.5 * 0.05), abs=0.01)
    assert result.value("difference_down") == pytest.approx(-0.5 * (0.9 + 2.5 * 0.05), abs=0.01)
