# SPDX-License-Identifier: Apache-2.0
"""Maps of a known module come out bin by bin; what does not fit together is refused."""

from __future__ import annotations

import numpy as np
import pytest
from friction_bench import FakeBench, Module

from screw_module_ros.identification import friction_map
from screw_module_ros.identification.friction_map import Settings
from screw_module_ros.identification.lab import Lab

SPEEDS = (0.005, 0.010, 0.020, 0.030, 0.050, 0.100, 0.150)
FEW = Settings(speeds=SPEEDS, inverted_speeds=(0.005, 0.050))


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return friction_map.run(Lab(FakeBench(), tmp_path_factory.mktemp("lab")), FEW)


@pytest.mark.parametrize(
    ("name", "sign", "upright"),
    [("up", 1, 1), ("down", -1, 1), ("up_inverted", 1, -1), ("down_inverted", -1, -1)],
)
def test_the_maps_are_the_module(result, name, sign, upright):
    z = np.linspace(-1.25e-3, 1.25e-3, 51)[:, None] + result.data["centres"] / 1e3
    module, row = Module(), SPEEDS.index(0.05)
    level = module.level(z, 0.05, sign * upright > 0).mean(axis=0)
    beyond = result.data[name][row] - (sign * level + upright * module.weight)
    assert np.nanmax(np.abs(beyond)) < 0.15
    assert np.isfinite(beyond).mean() > 0.97


def test_speeds_not_driven_upside_down_stay_empty(result):
    assert friction_map.measured(result.data, "up_inverted").tolist() == [0, 4]
    assert np.isnan(result.data["down_inverted"][1]).all()
    assert friction_map.nearest(result.data, "up_inverted", 0.02) == 0


def test_friction_is_least_where_the_module_has_its_stribeck_velocity(result):
    assert result.value("stribeck_up") == pytest.approx(0.02, abs=0.008)
    assert result.value("viscous_lower_up") == pytest.approx(2.5 * 7.7, rel=0.1)
    assert result.value("filled_up") > 0.97


def test_without_runs_upside_down_their_figures_are_left_out(result):
    data = {**result.data, "up_inverted": np.full((7, 142), np.nan)}
    assert "5-20" not in friction_map.draw(result._replace(data=data))


def test_the_default_is_the_thesis_s_plan():
    trials = friction_map._trials(Settings())
    assert len(trials) == 14 * 2 * 2
    assert sum(trial.upside_down for trial in trials.values()) == 28
