# SPDX-License-Identifier: Apache-2.0
"""The weight is found across the play; without play the maps give it with their bias."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from friction_bench import FakeBench, Module

from screw_module_ros.identification import friction_map, gravity
from screw_module_ros.identification.friction_map import MAPS
from screw_module_ros.identification.gravity import Crossing, Settings, weighed
from screw_module_ros.identification.lab import Lab, MissingResult
from screw_module_ros.identification.results import Result
from screw_module_ros.identification.trials import NotPossible
from screw_module_ros.plant.settings import load_world


def keep_maps(folder: Path, module: Module, inverted: bool = True) -> None:
    """Write maps of a module as friction_map would."""
    centres, speeds = 2.5 * (np.arange(142) + 0.5), np.array([0.005, 0.05])
    data = {"centres": centres, "speeds": speeds}
    for name in MAPS:
        way = 1.0 if name.startswith("up") else -1.0
        upright = -1.0 if "inverted" in name else 1.0
        rows = [
            way * module.level(centres / 1e3, speed, way * upright > 0.0) + upright * module.weight
            for speed in speeds
        ]
        data[name] = np.array(rows) * (1.0 if upright > 0.0 or inverted else np.nan)
    Result(friction_map.NAME, (), {}, (), data).save(folder)


def weigh(folder: Path, module: Module, **settings):
    keep_maps(folder, module)
    return gravity.run(Lab(FakeBench(module), folder), Settings()._replace(**settings))


@pytest.mark.parametrize(
    "module", [Module(), Module(weight=8.7, play=6.7e-5, against=2.0, film=1500.0, noise=0.05)]
)
def test_weight_and_play_are_found_whatever_friction_is(tmp_path, module):
    result = weigh(tmp_path, module)
    weight, play = result.quantity("gravity"), result.quantity("play")
    assert weight.value == pytest.approx(module.weight, abs=0.03)
    assert 0.0 < weight.uncertainty < 0.03
    assert play.value == pytest.approx(module.play, abs=3e-6)
    assert result.value("film") == pytest.approx(module.film, rel=0.1)


def test_the_thesis_s_method_is_off_by_half_of_what_gravity_changes(tmp_path):
    module = Module(against=-1.0)
    result = weigh(tmp_path, module)
    speed_factor = np.mean([0.9 + 2.5 * 0.005, 0.9 + 2.5 * 0.05])
    assert result.value("bias_thesis") == pytest.approx(-0.5 * speed_factor, abs=0.03)
    assert result.value("double_weight") == pytest.approx(2.0 * result.value("gravity_thesis"))
    assert any("thesis's method has an error of -0.4" in note for note in result.notes)


def test_without_play_the_maps_are_taken_and_it_is_said(tmp_path):
    result = weigh(tmp_path, Module(play=0.0, against=0.0))
    assert result.value("gravity") == pytest.approx(10.04, abs=0.01)
    assert result.value("play") == 0.0
    assert any("The handle crossed no play" in note for note in result.notes)


def test_without_play_and_maps_upside_down_there_is_no_way(tmp_path):
    module = Module(play=0.0)
    keep_maps(tmp_path, module, inverted=False)
    with pytest.raises(NotPossible, match="inverted_speeds"):
        gravity.run(Lab(FakeBench(module), tmp_path), Settings())


def test_with_one_speed_the_film_stays_in_the_weight_and_it_is_said(tmp_path):
    result = weigh(tmp_path, Module(), speeds=(0.0005,))
    assert result.value("gravity") == pytest.approx(10.04 + 0.35, abs=0.02)
    assert any("film's drag" in note for note in result.notes)


def test_crossings_both_ways_cancel_the_film_at_one_speed():
    def crossed(sign, way):
        force = sign * 10.0 + way * 0.35 + 0.02
        return Crossing(sign, way, 5e-4, 1e-4, 5e-4, force, 0.01)

    weight = weighed([crossed(sign, way) for sign in (1.0, -1.0) for way in (1.0, -1.0)])
    assert weight.weight == pytest.approx(10.0)
    assert weight.film == pytest.approx(700.0)
    assert weight.zero == pytest.approx(0.02)


def test_maps_must_be_there(tmp_path):
    with pytest.raises(MissingResult, match="friction_map"):
        gravity.run(Lab(FakeBench(), tmp_path), Settings())


def test_the_simulated_module_is_weighed(tmp_path, bench):
    keep_maps(tmp_path, Module())
    vertical = load_world().vertical
    result = gravity.run(Lab(bench, tmp_path), Settings())
    truth = vertical.moving_mass * vertical.gravity
    # The handle's own guide rubs against the crossing, which is always away from where the weight
    # rests: no run of this kind tells the two apart.
    assert result.value("gravity") == pytest.approx(truth + vertical.rail_friction, abs=0.05)
    assert result.value("play") == pytest.approx(vertical.play, abs=2e-6)
