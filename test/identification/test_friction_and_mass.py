# SPDX-License-Identifier: Apache-2.0
"""Weight, friction model and mass of modules by formulas are found (thesis 5.2 and 5.3)."""

from __future__ import annotations

import math

import numpy as np
import pytest
import yaml
from formula_stand import FormulaBench, Module, hand, keep

from screw_module_ros.calibration.module import (
    FRICTION_FORMAT,
    load_friction_model,
    thesis_friction,
)
from screw_module_ros.control.friction import friction_force
from screw_module_ros.identification import friction_map, friction_model, gravity, inertia
from screw_module_ros.identification.friction_map import MAPS, SPEEDS
from screw_module_ros.identification.friction_model import (
    friction_along,
    friction_model_of,
    held_force,
)
from screw_module_ros.identification.inertia import Motion, motion, ratio
from screw_module_ros.identification.lab import Lab
from screw_module_ros.identification.trials import RELEASE, WAYS_OUT, NotPossible
from screw_module_ros.identification.uncertainty import TRANSDUCER
from screw_module_ros.settings import plain

Z = 2.5 * (np.arange(142) + 0.5)
THESIS = thesis_friction()
FASTER = THESIS._replace(fastest_mm_s=2000.0)


def keep_maps(folder, speeds, force, names=MAPS):
    """Leave maps as friction_map does; force(way, upright, z, speed): of the stage [N]."""
    grid = np.meshgrid(Z, speeds)
    data = {"centres": Z, "speeds": np.array(speeds)}
    for name in names:
        way, upright = -1 if "down" in name else 1, -1 if "inverted" in name else 1
        data[name] = force(way, upright, *grid)
    keep(folder, friction_map.NAME, data)


def weigh(folder, module, inverted=True, **settings):
    """Run gravity on a module; inverted: friction_map was done upside down as well."""

    def force(way, upright, z, speed):
        level = module.level(z / 1e3, speed, way * upright > 0)
        known = 1.0 if inverted or upright > 0 else np.nan
        return known * (way * level + upright * module.weight)

    keep_maps(folder, (0.005, 0.05), force)
    return gravity.run(Lab(FormulaBench(module), folder), gravity.Settings(**settings))


@pytest.mark.parametrize(
    ("module", "settings", "hidden", "said"),
    [
        # The thesis's method is off by half of what gravity changes of the friction.
        (Module(), {},
         {"gravity": (10.04, 0.01), "guide": (0.3, 0.01), "play": (1e-4, 5e-7),
          "film": (700.0, 20.0), "bias_thesis": (-0.484, 0.03),
          "double_weight": (2.0 * 9.556, 0.06)},
         "thesis's method has an error of -0.4"),
        (Module(weight=8.7, play=6.7e-5, against=2.0, film=1500.0, guide=0.8, noise=0.05), {},
         {"gravity": (8.7, 0.02), "guide": (0.8, 0.02), "play": (6.7e-5, 1e-6),
          "film": (1500.0, 30.0), "bias_thesis": (0.969, 0.05)},
         "would give a weight 0.80 N too large"),
        (Module(play=0.0, against=0.0), {}, {"gravity": (10.04, 0.01), "play": (0.0, 0.0)},
         "did not cross a play"),
        # With one speed the film's drag stays in the guide's friction, not in the weight.
        (Module(), {"speeds": (0.0005,)},
         {"gravity": (10.04, 0.01), "guide": (0.3 + 0.35, 0.01)}, "includes the film's drag"),
    ],
)  # fmt: skip
def test_weight_and_play_are_found_whatever_friction_is(tmp_path, module, settings, hidden, said):
    result = weigh(tmp_path, module, **settings)
    for name, (value, margin) in hidden.items():
        quantity = result.quantity(name)
        assert quantity.value == pytest.approx(value, abs=margin), name
        if quantity.sources:
            assert abs(quantity.value - value) < 3.0 * quantity.uncertainty, name
    assert said in " ".join(result.notes)


@pytest.mark.parametrize("guide", [0.0, 0.3, 0.8])
def test_friction_of_the_guide_never_goes_to_the_controller_as_weight(tmp_path, guide):
    weight = weigh(tmp_path, Module(guide=guide)).quantity("gravity")
    assert abs(weight.value - Module().weight) < 3.0 * weight.uncertainty < 0.02


def test_maps_alone_state_what_they_cannot_see(tmp_path):
    """Without play the weight comes from the maps, which take half of a difference for weight."""
    module = Module(play=0.0, against=-1.0)
    weight = weigh(tmp_path, module).quantity("gravity")
    low, high = weight.interval
    assert abs(weight.value - module.weight) > 0.4 and low < module.weight < high
    assert any("cannot see" in source.what for source in weight.sources)


def test_a_real_bench_adds_what_no_simulation_has(tmp_path):
    """The guide's load and the transducer's calibration; without a simulated rig's `RELEASE`."""

    class RealBench(FormulaBench):
        offers = frozenset(WAYS_OUT) - {RELEASE}

    keep_maps(tmp_path, (0.05,), lambda way, upright, z, speed: np.full_like(z, np.nan))
    stand = RealBench(Module(guide=0.8))
    weight = gravity.run(Lab(stand, tmp_path), gravity.Settings()).quantity("gravity")
    assert [source.what for source in weight.sources][1:] == [
        "the guide may rub more under the larger load of the way against gravity", TRANSDUCER,
    ]  # fmt: skip
    assert 0.05 < weight.uncertainty < 0.15


def test_without_play_and_maps_upside_down_there_is_no_way(tmp_path):
    with pytest.raises(NotPossible, match="inverted_speeds"):
        weigh(tmp_path, Module(play=0.0), inverted=False)


def test_a_way_that_was_not_seen_leaves_no_half(tmp_path):
    """A run counts only with both crossings: one alone holds the guide's friction."""
    keep_maps(tmp_path, (0.05,), lambda way, upright, z, speed: np.full_like(z, np.nan))
    stand = FormulaBench(Module(noise=0.0))
    lab = Lab(stand, tmp_path)
    whole = stand.record

    def lamed(trial, told):
        samples = whole(trial, told)
        half = len(samples.force) // 2
        samples.force[half:] += np.linspace(0.0, 40.0, len(samples.force) - half)  # no plateau
        return samples

    stand.record = lamed
    with pytest.raises(NotPossible, match="inverted_speeds"):
        gravity.run(lab, gravity.Settings())


def test_the_simulated_module_is_weighed(tmp_path, stand):
    """Within three of the standard deviations that it states, its guide's friction known."""
    keep_maps(tmp_path, (0.05,), lambda way, upright, z, speed: 10.0 * upright + 0.0 * z)
    result = gravity.run(Lab(stand, tmp_path), gravity.Settings())
    vertical = stand.world.vertical
    for name, truth, margin in (
        ("gravity", vertical.moving_mass * vertical.gravity, 0.01),
        ("guide", vertical.rail_friction, 0.02),
        ("film", vertical.film_damping, 20.0),
        ("play", vertical.play, 1e-6),
    ):
        found = result.quantity(name)
        assert abs(found.value - truth) < min(margin, 3.0 * found.uncertainty), name


def another(phase: float, flip: float, weight: float = 9.3):
    """The thesis's friction with another phase, flip, weight and level."""

    def stronger(branch, side):
        trend = [1.2 * c for c in branch.trend]
        trend[-1] += weight - 1.2 * THESIS.gravity_N
        ripple = tuple(1.3 * c for c in branch.ripple)
        return branch._replace(trend=tuple(trend), ripple=ripple, flip_below_mm=side)

    return THESIS._replace(
        phase_rad=phase, gravity_N=weight, up=stronger(THESIS.up, -1.0),
        down=stronger(THESIS.down, flip),
    )  # fmt: skip


def fitted(folder, model, noise=0.1, module=None, **kept):
    """Fit maps of a friction model on a module.

    kept: the heights that a map has, by name; else all but few.
    """
    random = np.random.default_rng(3)

    def force(way, upright, z, speed):
        held = held_force(model, z, way * speed * 1e3) + random.normal(0.0, noise, z.shape)
        there = kept.get("up" if way > 0 else "down", (z < 347.5) | (speed > 0.01))
        return np.where(there, held, np.nan)

    keep_maps(folder, SPEEDS, force, ("up", "down"))
    keep(folder, gravity.NAME, gravity=model.gravity_N)
    return friction_model.run(Lab(FormulaBench(module), folder), friction_model.Settings())


@pytest.mark.parametrize(("phase", "flip"), [(0.385, 212.5), (-2.6, -1.0)])
def test_the_friction_model_is_found_and_its_file_accepted(tmp_path, phase, flip):
    truth = another(phase, flip)
    result = fitted(tmp_path, truth)
    model = friction_model_of(result)
    for velocity in (2.0, 60.0, -2.0, -60.0):
        there = held_force(model, Z, np.full_like(Z, velocity))
        assert there == pytest.approx(held_force(truth, Z, np.full_like(Z, velocity)), abs=0.25)
    assert abs(math.remainder(model.phase_rad - phase, 2.0 * math.pi)) < 0.03
    assert result.value("flip_up") < 0.0
    assert result.value("flip_down") * 1e3 == pytest.approx(flip, abs=5.1)
    assert result.value("within") > 0.999 and model.gravity_N == 9.3
    assert result.value("rms") == pytest.approx(0.1, rel=0.1)
    assert any("ripple flip has no benefit" in note for note in result.notes)
    file = tmp_path / "friction.yaml"
    file.write_text(yaml.safe_dump({"format": FRICTION_FORMAT, "version": 1, **plain(model)}))
    assert load_friction_model(file) == model


@pytest.mark.parametrize("lead", [0.0127, 0.0254])
def test_the_ripple_of_another_screw_is_found_by_its_own_lead(tmp_path, lead):
    """With 19.05 mm taken for granted the fit left the whole ripple."""
    truth = another(0.385, 212.5)._replace(lead_mm=1e3 * lead)
    result = fitted(tmp_path, truth, module=Module(lead=lead))
    model = friction_model_of(result)
    assert model.lead_mm == pytest.approx(1e3 * lead)
    assert abs(math.remainder(model.phase_rad - 0.385, 2.0 * math.pi)) < 0.03
    assert result.value("within") > 0.999
    assert result.value("rms") == pytest.approx(0.1, rel=0.1)
    (tmp_path / "taken").mkdir()
    granted = fitted(tmp_path / "taken", truth)
    assert granted.value("within") < 0.9 and granted.value("rms") > 5.0 * result.value("rms")


def test_the_thesis_s_coefficients_fit_the_thesis_s_module_alone(tmp_path):
    other, own = fitted(tmp_path, another(1.5, 150.0)), fitted(tmp_path, THESIS, noise=0.01)
    assert other.value("within_thesis") < 0.9 < other.value("within")
    assert other.value("rms_thesis") > other.value("rms")
    assert own.value("within_thesis") == 1.0
    assert own.value("factor_fastest_up") == pytest.approx(1.3, abs=0.08)  # 5.2.5: "about 1.3"
    assert own.value("factor_slowest_up") == pytest.approx(0.7, abs=0.08)  # "roughly 0.75"


@pytest.mark.parametrize(("low", "high", "speed"), [(-0.01, 0.37, 0.3), (0.2, 0.2, 0.001)])
def test_the_arrays_agree_with_the_controller_s_function(low, high, speed):
    position, velocity = np.linspace(low, high, 61), np.linspace(-speed, speed, 61)
    wanted = [friction_force(THESIS, z, v) for z, v in zip(position, velocity, strict=True)]
    assert friction_along(THESIS, position, velocity) == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize(
    "there",
    [(Z > 150.0) & (Z < 180.0), (Z > 150.0) & (Z < 200.0), (Z < 40.0) | (Z > 320.0)],
    ids=["too few bins for the polynomials", "too few between them", "a gap"],
)
def test_heights_that_do_not_determine_the_polynomials_are_refused(tmp_path, there):
    """The fit was singular, or off by 20 N between the bins and accepted as a calibration."""
    with pytest.raises(ValueError, match="the map up does not determine the model's form"):
        fitted(tmp_path, THESIS, up=there, down=there)


def test_no_direction_is_extrapolated_to_heights_of_the_other(tmp_path):
    """Above the highest bin of one direction its polynomial gave 4 to 750 N."""
    model = friction_model_of(fitted(tmp_path, THESIS, up=Z < 300.0))
    assert (model.low_mm, model.high_mm) == (0.0, 300.0)
    z, upward = np.linspace(0.0, 0.3, 301), np.full(301, 0.02)
    wanted = friction_along(THESIS, z, upward)
    assert friction_along(model, z, upward) == pytest.approx(wanted, abs=0.5)


class ThesisBench(FormulaBench):
    """Friction of the thesis's model, times `share`; the force comes `late` by some samples."""

    share, late = 1.0, 0

    def _motion(self, trial):
        time, z, v, a = hand(trial, self.rate)
        friction = self.share * friction_along(FASTER, z, v)
        force = self.module.mass * a + friction + THESIS.gravity_N
        return time, z, np.roll(force, self.late)


def swung(folder, mass=5.49, share=1.0, **settings):
    """Run inertia with the thesis's friction model."""
    keep(folder, friction_model.NAME, friction_model._as_data(THESIS))
    stand = ThesisBench(Module(mass=mass, noise=0.05))
    stand.share = share
    return inertia.run(Lab(stand, folder), inertia.Settings(duration=4.0, **settings))


@pytest.mark.parametrize(
    ("mass", "share", "hidden"),
    [
        (4.7, 1.0, {"mass": (4.7, 0.05), "mass_thesis_strict": (4.7, 0.09), "shift": (0.0, 3e-3)}),
        (6.4, 1.0, {"mass": (6.4, 0.06), "mass_thesis_strict": (6.4, 0.13), "shift": (0.0, 3e-3)}),
        # With a friction model that is a fifth short the mass stays within a tenth.
        (5.49, 1.25, {"mass": (5.49, 0.55)}),
    ],
)
def test_the_mass_is_found(tmp_path, mass, share, hidden):
    result = swung(tmp_path, mass, share)
    for name, (value, margin) in hidden.items():
        assert result.value(name) == pytest.approx(value, abs=margin), name
    assert 0.0 < result.quantity("mass").uncertainty < (0.1 if share == 1.0 else 0.2)
    left = result.value("coulomb_left") + 0.5 * result.value("viscous_left")
    assert (left > 1.0) == (share > 1.0), "friction beyond the model"
    strict, printed = result.quantity("mass_thesis_strict"), result.quantity("mass_thesis")
    assert printed.uncertainty > 3.0 * strict.uncertainty, "worthless near zero acceleration"
    assert any("standard deviation" in note for note in result.notes)


def test_the_shift_finds_a_force_that_comes_late():
    stand = ThesisBench(Module(noise=0.0))
    stand.late = 16  # 8 ms, as in fig 5-33
    trials = inertia._trials(inertia.Settings(duration=4.0))
    samples = stand.record(list(trials.values())[2], None)
    record = motion(samples.time, samples.position, samples.force)
    friction = friction_along(FASTER, record.position, record.velocity)
    found = ratio(record, record.force - np.roll(friction, 16) - THESIS.gravity_N, 0.02, 2.5, 0.03)
    assert found.shift == pytest.approx(0.008, abs=0.001)
    assert np.nanmean(found.mass) == pytest.approx(5.49, rel=0.01)


def test_slow_and_unaccelerated_samples_are_left_out(tmp_path):
    velocity = np.array([0.019, 0.02, -0.5, 0.5])
    acceleration = np.array([3.0, 3.0, -3.0, 0.002])
    record = Motion(np.arange(4.0), velocity, velocity, acceleration, velocity, velocity)
    found = ratio(record, 5.0 * acceleration, 0.02, 0.0025, 0.0)
    assert np.isfinite(found.mass).tolist() == [False, True, True, False]
    with pytest.raises(ValueError, match="fast enough"):
        swung(tmp_path, amplitudes=(0.005,), omegas=(1.0,))
