# SPDX-License-Identifier: Apache-2.0
"""Maps made from a known model give that model back, whatever its phase and flip."""

from __future__ import annotations

import math

import numpy as np
import pytest
import yaml
from friction_bench import FakeBench

from screw_module_ros.calibration.module import (
    FRICTION_FORMAT,
    load_friction_model,
    thesis_friction,
)
from screw_module_ros.control.friction import friction_force
from screw_module_ros.identification import friction_map, friction_model, gravity
from screw_module_ros.identification.friction_map import SPEEDS
from screw_module_ros.identification.friction_model import (
    Settings,
    friction_along,
    friction_model_of,
    held_force,
)
from screw_module_ros.identification.lab import Lab
from screw_module_ros.identification.results import Quantity, Result
from screw_module_ros.settings import plain

THESIS = thesis_friction()
Z = 2.5 * (np.arange(142) + 0.5)
WEIGHT = 9.3


def another(phase: float, flip: float):
    """The thesis's module with another phase, flip, weight and level."""
    def stronger(branch, side):
        trend = [1.2 * c for c in branch.trend]
        trend[-1] += WEIGHT - 1.2 * THESIS.gravity_N
        return branch._replace(
            trend=tuple(trend), ripple=tuple(1.3 * c for c in branch.ripple), flip_below_mm=side
        )

    return THESIS._replace(
        phase_rad=phase,
        gravity_N=WEIGHT,
        up=stronger(THESIS.up, -1.0),
        down=stronger(THESIS.down, flip),
    )


def keep_maps(folder, model, noise: float = 0.1, missing: bool = True) -> None:
    """Write maps and weight of a model, as the experiments before would."""
    random = np.random.default_rng(3)
    speeds = np.array(SPEEDS)
    data = {"centres": Z, "speeds": speeds}
    for way, sign in (("up", 1.0), ("down", -1.0)):
        data[way] = held_force(model, *np.meshgrid(Z, sign * speeds * 1e3))
        data[way] += random.normal(0.0, noise, data[way].shape)
        if missing:
            data[way][-3:, :3] = np.nan
    Result(friction_map.NAME, (), {}, (), data).save(folder)
    weight = Quantity("gravity", model.gravity_N, 0.01, "N", "weight")
    Result(gravity.NAME, (weight,), {}).save(folder)


def fitted(folder, model, **keep):
    keep_maps(folder, model, **keep)
    return friction_model.run(Lab(FakeBench(), folder), Settings())


@pytest.mark.parametrize(("phase", "flip"), [(0.385, 212.5), (-2.6, -1.0)])
def test_the_model_is_found_again(tmp_path, phase, flip):
    truth = another(phase, flip)
    result = fitted(tmp_path, truth)
    model = friction_model_of(result)
    for velocity in (2.0, 60.0, -2.0, -60.0):
        there = held_force(model, Z, np.full_like(Z, velocity))
        assert there == pytest.approx(held_force(truth, Z, np.full_like(Z, velocity)), abs=0.25)
    assert abs(math.remainder(model.phase_rad - phase, 2.0 * math.pi)) < 0.03
    assert result.value("flip_up") < 0.0
    assert result.value("flip_down") * 1e3 == pytest.approx(flip, abs=5.1)
    assert result.value("within") > 0.999
    assert result.value("rms") == pytest.approx(0.1, rel=0.1)
    assert model.gravity_N == WEIGHT
    assert any("ripple flip has no benefit" in note for note in result.notes)


def test_the_thesis_s_coefficients_do_worse_on_another_module(tmp_path):
    result = fitted(tmp_path, another(1.5, 150.0))
    assert result.value("within_thesis") < 0.9 < result.value("within")
    assert result.value("rms_thesis") > result.value("rms")


def test_the_thesis_s_own_maps_give_the_thesis_s_figures(tmp_path):
    result = fitted(tmp_path, THESIS, noise=0.01)
    assert result.value("within_thesis") == 1.0
    assert result.value("factor_fastest_up") == pytest.approx(1.3, abs=0.08)  # 5.2.5: "about 1.3"
    assert result.value("factor_slowest_up") == pytest.approx(0.7, abs=0.08)  # "roughly 0.75"


def test_the_model_s_file_is_accepted_by_the_controller(tmp_path):
    model = friction_model_of(fitted(tmp_path, another(1.0, 200.0)))
    file = tmp_path / "friction.yaml"
    file.write_text(yaml.safe_dump({"format": FRICTION_FORMAT, "version": 1, **plain(model)}))
    assert load_friction_model(file) == model


def test_the_arrays_agree_with_the_controller_s_function():
    position = np.linspace(-0.01, 0.37, 60)
    velocity = np.linspace(-0.3, 0.3, 60)
    wanted = [friction_force(THESIS, z, v) for z, v in zip(position, velocity, strict=True)]
    assert friction_along(THESIS, position, velocity) == pytest.approx(wanted, abs=1e-9)
    slow = np.array([-0.001, 0.0, 0.0005])
    wanted = [friction_force(THESIS, 0.2, v) for v in slow]
    assert friction_along(THESIS, np.full(3, 0.2), slow) == pytest.approx(wanted, abs=1e-9)


def cut(folder, **kept) -> None:
    """Empty the bins of the maps, by name, whose height is not kept."""
    maps = Lab(FakeBench(), folder).result(friction_map.NAME)
    for way, there in kept.items():
        maps.data[way][:, ~there] = np.nan
    maps.save(folder)


@pytest.mark.parametrize(
    "there",
    [(Z > 150.0) & (Z < 180.0), (Z > 150.0) & (Z < 200.0), (Z < 40.0) | (Z > 320.0)],
    ids=["too few bins for the polynomials", "too few between them", "a gap"],
)
def test_heights_that_do_not_determine_the_polynomials_are_refused(tmp_path, there):
    """The fit was singular, or off by 20 N between the bins and accepted as a calibration."""
    keep_maps(tmp_path, THESIS)
    cut(tmp_path, up=there, down=there)
    with pytest.raises(ValueError, match="the map up does not determine the model's form"):
        friction_model.run(Lab(FakeBench(), tmp_path), Settings())


def test_no_direction_is_extrapolated_to_heights_of_the_other(tmp_path):
    """Above the highest bin of one direction its polynomial gave 4 to 750 N."""
    keep_maps(tmp_path, THESIS)
    cut(tmp_path, up=Z < 300.0)
    model = friction_model_of(friction_model.run(Lab(FakeBench(), tmp_path), Settings()))
    assert (model.low_mm, model.high_mm) == (0.0, 300.0)
    for z in np.linspace(0.0, 0.3, 301):
        there = friction_force(model, z, 0.02)
        assert there == pytest.approx(friction_force(THESIS, z, 0.02), abs=0.5)
