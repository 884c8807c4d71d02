# SPDX-License-Identifier: Apache-2.0
"""The plant file: everything wrong with it is named; perturbed rigs are repeatable."""

from __future__ import annotations

import copy
import math
import random

import pytest
import yaml

from screw_module_ros.plant.settings import (
    DEFAULT_FILE,
    changed_later,
    load_world,
)
from screw_module_ros.resources import resource_path
from screw_module_ros.settings import SettingError, validated


@pytest.fixture(scope="module")
def content():
    return yaml.safe_load(resource_path(DEFAULT_FILE).read_text())


@pytest.fixture
def load(content, tmp_path):
    """Load a copy of the default file after `edit(content)`."""

    def loader(edit):
        edited = copy.deepcopy(content)
        edit(edited)
        path = tmp_path / "plant.yaml"
        path.write_text(yaml.safe_dump(edited))
        return load_world(path)

    return loader


def test_default_file_holds_the_thesis(settings):
    assert settings.vertical.turning_mass + settings.vertical.moving_mass == pytest.approx(5.49)
    assert settings.vertical.moving_mass * settings.vertical.gravity == pytest.approx(
        10.04, abs=0.01
    )
    assert settings.vertical.lead / settings.start.counts_per_turn == pytest.approx(9.525e-7)
    assert settings.vertical.play == 1e-4


def test_an_edited_copy_is_read(load):
    assert load(lambda c: c["vertical"].update(play=0)).vertical.play == 0.0


@pytest.mark.parametrize(
    ("edit", "named"),
    [
        (lambda c: c["vertical"].update(plya=1.0), "vertical.plya"),
        (lambda c: c["vertical"].pop("play"), "vertical.play is missing"),
        (lambda c: c["vertical"].update(play=-1.0), "vertical.play = -1.0 m: below"),
        (lambda c: c["vertical"].update(play="1e-4"), "vertical.play = '1e-4': a finite number"),
        (lambda c: c["vertical"].update(play=float("nan")), "vertical.play = nan: a finite"),
        (lambda c: c["vertical"].update(play=True), "vertical.play = True: a finite"),
        (lambda c: c["friction"]["along"]["trend"].pop(), "a list of 8 is wanted"),
        (lambda c: c["friction"]["along"].update(side=0.5), "friction.along.side"),
        (lambda c: c["friction"].update(against=3), "friction.against = 3: a mapping"),
        (lambda c: c["arm"].update(kind="angry"), "arm.kind"),
        (lambda c: c["start"].update(locked="no"), "start.locked = 'no': bool"),
        (lambda c: c["start"].update(position=0.4), "start.position = 0.4 m lies above"),
        (lambda c: c["start"].update(y=0.9), "out of reach"),
        (lambda c: c["planar"].update(between_low=2.8), "planar.between_low"),
        (lambda c: c.update(substep=1.0e-5), "substep"),
        (lambda c: c.pop("planar"), "planar is missing"),
    ],
)
def test_what_is_wrong_is_named(load, edit, named):
    with pytest.raises(SettingError) as caught:
        load(edit)
    assert named in str(caught.value)
    assert "plant.yaml" in str(caught.value)


def test_unreadable_files_are_named(tmp_path):
    with pytest.raises(SettingError, match=r"nowhere\.yaml cannot be read"):
        load_world(tmp_path / "nowhere.yaml")
    for text in ("a: [1, 2", "- just\n- a list\n", ""):
        path = tmp_path / "bad.yaml"
        path.write_text(text)
        with pytest.raises(SettingError, match=r"bad\.yaml"):
            load_world(path)


def test_perturbed_rigs_differ_by_seed_and_repeat(settings):
    rigs = [load_world(perturb_seed=seed) for seed in range(20)]
    assert load_world(perturb_seed=3) == rigs[3]
    for rig in rigs:
        validated(rig)
        assert rig != settings
    for value in (
        lambda rig: rig.friction.scale,
        lambda rig: rig.vertical.moving_mass,
        lambda rig: rig.vertical.turning_mass,
        lambda rig: rig.amplifier.dead_zone,
    ):
        ratios = [value(rig) / value(settings) for rig in rigs]
        assert len(set(ratios)) == len(rigs)
        assert all(0.7 < ratio < 1.4 for ratio in ratios)
        assert max(ratios) - min(ratios) > 0.1


@pytest.mark.parametrize(
    "value",
    [
        lambda rig: rig.vertical.contact_stiffness,
        lambda rig: rig.vertical.film_damping,
        lambda rig: rig.vertical.rail_friction,
        lambda rig: rig.friction.stiffness,
        lambda rig: rig.friction.stribeck_speed,
        lambda rig: rig.friction.load_gain,
        lambda rig: rig.friction.roller_slip,
        lambda rig: rig.friction.wave,
        lambda rig: rig.friction.against.trend[-1],
        lambda rig: rig.amplifier.delay,
        lambda rig: rig.sensor.force_noise,
        lambda rig: rig.sensor.bandwidth,
    ],
)
def test_perturbing_reaches_what_nobody_measures(value):
    assert len({value(load_world(perturb_seed=seed)) for seed in range(10)}) == 10


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
