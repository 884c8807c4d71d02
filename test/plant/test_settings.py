# SPDX-License-Identifier: Apache-2.0
"""The plant file: everything wrong with it is named; perturbed rigs are repeatable."""

from __future__ import annotations

import math
import random
from functools import reduce
from operator import attrgetter, getitem

import pytest
import yaml

from screw_module_ros.plant.settings import (
    DEFAULT_FILE,
    changed_later,
    load_world,
)
from screw_module_ros.resources import resource_path
from screw_module_ros.settings import SettingError, validated

DEFAULTS = resource_path(DEFAULT_FILE).read_text()
MISSING = object()


def perturbed(count=20):
    return [load_world(perturb_seed=seed) for seed in range(count)]


@pytest.fixture
def load(tmp_path):
    """Load a copy of the default file in which one thing is set, or taken away."""

    def loader(place, value):
        content = yaml.safe_load(DEFAULTS)
        *groups, last = place.split(".")
        group = reduce(getitem, groups, content)
        group[last] = value
        if value is MISSING:
            del group[last]
        (tmp_path / "plant.yaml").write_text(yaml.safe_dump(content))
        return load_world(tmp_path / "plant.yaml")

    return loader


def test_default_file_holds_the_thesis(settings):
    module = settings.vertical
    assert module.turning_mass + module.moving_mass == pytest.approx(5.49)
    assert module.moving_mass * module.gravity == pytest.approx(10.04, abs=0.01)
    assert module.lead / settings.start.counts_per_turn == pytest.approx(9.525e-7)
    assert module.play == 1e-4
    assert 5e-6 < 10.0 / settings.friction.stiffness < 1e-4, "before it slides [m]"


def test_an_edited_copy_is_read(load):
    assert load("vertical.play", 0).vertical.play == 0.0


@pytest.mark.parametrize(
    ("place", "value", "named"),
    [
        ("vertical.plya", 1.0, "vertical.plya"),
        ("vertical.play", MISSING, "vertical.play is missing"),
        ("vertical.play", -1.0, "vertical.play = -1.0 m: below"),
        ("vertical.play", "1e-4", "vertical.play = '1e-4': a finite number"),
        ("vertical.play", math.nan, "vertical.play = nan: a finite"),
        ("vertical.play", True, "vertical.play = True: a finite"),
        ("friction.along.trend", [1.0] * 7, "a list of 8 is wanted"),
        ("friction.along.side", 0.5, "friction.along.side"),
        ("friction.against", 3, "friction.against = 3: a mapping"),
        ("arm.kind", "angry", "arm.kind"),
        ("start.locked", "no", "start.locked = 'no': bool"),
        ("start.position", 0.4, "start.position = 0.4 m lies above"),
        ("start.y", -0.9, "out of reach"),
        ("planar.between_low", -0.4, "planar.between_low"),
        ("planar.between_high", 0.3, "both must have one sign"),
        ("planar.elbow", "up", "planar.elbow = 'up': one of 'right', 'left'"),
        ("planar.elbow", "left", "beyond the stops planar.shoulder_*"),
        ("planar.base_y", -0.60, "beyond the stops planar.shoulder_*"),
        ("planar.inertia", "mine", "planar.inertia = 'mine': one of 'appendix_d', 'inmotion2'"),
        ("planar.inmotion2.elbow", 0.0, "planar.inmotion2.elbow"),
        ("substep", 1.0e-5, "substep"),
        ("planar", MISSING, "planar is missing"),
    ],
)
def test_what_is_wrong_is_named(load, place, value, named):
    with pytest.raises(SettingError) as caught:
        load(place, value)
    assert named in str(caught.value)
    assert "plant.yaml" in str(caught.value)


@pytest.mark.parametrize("text", ["a: [1, 2", "- just\n- a list\n", ""])
def test_unreadable_files_are_named(tmp_path, text):
    (tmp_path / "bad.yaml").write_text(text)
    with pytest.raises(SettingError, match=r"bad\.yaml"):
        load_world(tmp_path / "bad.yaml")


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(SettingError, match=r"nowhere\.yaml cannot be read"):
        load_world(tmp_path / "nowhere.yaml")


def test_perturbed_rigs_differ_by_seed_and_repeat(settings):
    rigs = perturbed()
    assert load_world(perturb_seed=3) == rigs[3]
    for rig in rigs:
        validated(rig)
        assert rig != settings


@pytest.mark.parametrize(
    "place",
    ["friction.scale", "vertical.moving_mass", "vertical.turning_mass", "amplifier.dead_zone"],
)
def test_perturbing_reaches_what_is_calibrated_and_not_too_far(settings, place):
    ratios = {attrgetter(place)(rig) / attrgetter(place)(settings) for rig in perturbed()}
    assert len(ratios) == 20
    assert 0.7 < min(ratios) < max(ratios) - 0.1 < 1.3


@pytest.mark.parametrize(
    "place",
    [
        "vertical.contact_stiffness",
        "vertical.film_damping",
        "vertical.rail_friction",
        "friction.stiffness",
        "friction.stribeck_speed",
        "friction.load_gain",
        "friction.roller_slip",
        "friction.wave",
        "friction.against.trend",
        "amplifier.delay",
        "planar.structure_stiffness",
        "planar.structure_damping_ratio",
        "sensor.force_noise",
        "sensor.bandwidth",
    ],
)
def test_perturbing_reaches_what_nobody_measures(place):
    assert len(set(map(attrgetter(place), perturbed(10)))) == 10


def test_what_a_seed_drew_before_it_still_draws():
    """Reports of earlier versions name rigs by seed: the first stream is as it was."""
    rig, printed = load_world(perturb_seed=3), load_world()
    draw = random.Random("plant 3")
    ripple, slope = draw.uniform(-0.4, 0.4), draw.uniform(-0.3, 0.3)
    mine, theirs = rig.friction.against, printed.friction.against
    assert mine.rotation[0] == pytest.approx(math.exp(ripple) * theirs.rotation[0])
    assert mine.slope == pytest.approx(math.exp(slope) * theirs.slope)


def test_a_rig_changes_after_it_was_calibrated(settings):
    later = [changed_later(settings, seed) for seed in range(10)]
    assert changed_later(settings, 3) == later[3]
    for rig in later:
        validated(rig)
        assert rig.vertical.moving_mass != settings.vertical.moving_mass
        assert rig.friction.roller_phase != settings.friction.roller_phase
        assert rig.vertical.turning_mass == settings.vertical.turning_mass
    assert len({rig.friction.scale for rig in later}) == 10
