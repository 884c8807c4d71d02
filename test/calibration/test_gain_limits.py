# SPDX-License-Identifier: Apache-2.0
"""A module's gain limits: what they limit, what they exceed, and what is refused."""

import math
import re

import pytest
import yaml

from screw_module_ros.calibration.gain_limits import (
    LEAST,
    MOST,
    conditions_of,
    law_version,
    load_gain_limits,
    text_checksum,
)
from screw_module_ros.calibration.selection import GainLimitsSettings, chosen_gain_limits
from screw_module_ros.control import modes
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.settings import SettingError

SERIAL = "ARM-0007"


RATE = 1000.0
LAW = VerticalSettings(mass=5.437218, observer_inertia=0.35)
CONDITIONS = conditions_of(LAW, RATE, 1.26e-3, 30.0)


LARGEST = """
  hand: {force_gain: 14.1, observer_gain: 23}
  heavy_arm: {force_gain: 6.28, observer_gain: 16}
  wall: {force_gain: 9.5, observer_gain: 12.6}
"""
EXCEEDS = "{soft_grip: {force_gain: 0.92, observer_gain: 0.51}, light_wall: {force_gain: 0.07}}"


def written(
    folder, largest=LARGEST, exceeds=EXCEEDS, serial=SERIAL, conditions=CONDITIONS, law=None,
):
    """Write a file of gain limits; return its path."""
    return signed(
        folder / "module_gain_limits.yaml",
        f"format: screw_module_ros/gain_limits\nversion: 2\nserial: {serial}\n"
        f"date: '2026-11-22T09:30:00Z'\nlaw: '{law or law_version()}'\n"
        f"largest_gains_on: {largest}\nexceeds: {exceeds}\n",
        conditions,
    )


def signed(file, text, conditions):
    """Write a text with conditions and checksum; return the path."""
    text += yaml.safe_dump({"conditions": conditions._asdict()}) if conditions else ""
    file.write_text(f"{text}sha256: {text_checksum(text)}\n")
    return file


def test_no_file_limits_nothing():
    assert chosen_gain_limits(GainLimitsSettings(), "") is None


@pytest.mark.parametrize(
    ("mode", "field"), [(modes.FORCE_FEEDBACK, "force_gain"), (modes.COMBINED, "force_gain"),
                        (modes.OBSERVER, "observer_gain")]
)  # fmt: skip
def test_a_gain_beyond_it_is_refused_in_the_modes_that_use_it(tmp_path, mode, field):
    limits = load_gain_limits(written(tmp_path), SERIAL)
    most = getattr(limits.largest, field)
    at_most = LAW._replace(**{field: most})
    beyond = at_most._replace(**{field: most + 0.01})
    assert not limits.refusal(at_most, mode, RATE)
    assert re.search(f"{field} is .*ARM-0007.* at most", limits.refusal(beyond, mode, RATE))
    assert not limits.refusal(beyond, modes.IMPEDANCE, RATE)


def departed(name, share):
    """Return law and rate with one condition of the limits times a share."""
    if name == "rate":
        return LAW, RATE * share
    return LAW._replace(**{name: share * getattr(LAW, name)}), RATE


@pytest.mark.parametrize("mode", [modes.FORCE_FEEDBACK, modes.COMBINED, modes.OBSERVER])
@pytest.mark.parametrize(
    ("names", "name"), [(names, name) for names in (LEAST, MOST) for name in names]
)
def test_a_condition_that_costs_margin_is_refused_in_the_modes_it_matters_in(
    tmp_path, mode, names, name
):
    """With 30 Hz in place of 9 the gain that is stable on a heavy arm falls from 16 to 5."""
    limits = load_gain_limits(written(tmp_path), SERIAL)
    worse, better = (0.999, 1.001) if names is LEAST else (1.001, 0.999)
    for share in (1.0,) if name in LEAST and name in MOST else (1.0, better):
        law, rate = departed(name, share)
        assert not limits.refusal(law, mode, rate)
    law, rate = departed(name, worse)
    told = limits.refusal(law, mode, rate)
    gain = "observer_gain" if mode == modes.OBSERVER else "force_gain"
    if gain in names[name]:
        limit = "at least" if names is LEAST else "at most"
        wanted = getattr(CONDITIONS, name)
        assert re.search(f"{name} is .*ARM-0007.* {wanted:.10g}.* {limit}.*beyond_gain", told)
    else:
        assert not told
    assert not limits.refusal(law, modes.IMPEDANCE, rate)


def test_limits_without_their_conditions_are_refused(tmp_path):
    with pytest.raises(SettingError, match="conditions is missing.*run stability"):
        load_gain_limits(written(tmp_path, conditions=None), SERIAL)
    with pytest.raises(SettingError, match="conditions.delay = nan: a finite number"):
        load_gain_limits(written(tmp_path, conditions=CONDITIONS._replace(delay=math.nan)), SERIAL)


def test_limits_for_another_version_of_the_law_are_refused(tmp_path):
    with pytest.raises(SettingError, match="version 0123456789ab of the law.* run stability"):
        load_gain_limits(written(tmp_path, law="0123456789ab"), SERIAL)


@pytest.mark.parametrize(
    ("change", "serial", "told"),
    [
        (("force_gain: 6.28", "force_gain: 9.28"), SERIAL, "sha256: the file was changed"),
        (("version: 2", "version: 1"), SERIAL, "version = 1: .* and 2 are wanted"),
        (("sha256:", "sha257:"), SERIAL, "sha257 is unknown"),
        (("", ""), "ARM-0008", "module 'ARM-0007', this is module 'ARM-0008'.*name the file of th"),
        (("", ""), "", "set module_serial to the serial on the module"),
    ],
)
def test_another_modules_or_a_changed_one_is_refused(tmp_path, change, serial, told):
    file = written(tmp_path)
    file.write_text(file.read_text().replace(*change, 1))
    with pytest.raises(SettingError, match=told) as error:
        load_gain_limits(file, serial)
    assert str(file) in str(error.value)


ON_HAND = "{force_gain: 14.1, observer_gain: 23}"


@pytest.mark.parametrize(
    ("gains", "told"),
    [
        ("{force_gain: 6.28}", "largest_gains_on.hand.observer_gain is missing"),
        ("{force_gain: .inf, observer_gain: 9}", "largest_gains_on.hand.force_gain = inf"),
        ("{force_gain: -1, observer_gain: 9}", "force_gain = -1.0: below the smallest allowed, 0"),
        ("[6.28, 12.6]", "largest_gains_on.hand = .*: a mapping"),
    ],
)
def test_gains_that_are_none_are_refused(tmp_path, gains, told):
    with pytest.raises(SettingError, match=told):
        load_gain_limits(written(tmp_path, LARGEST.replace(ON_HAND, gains)), SERIAL)


@pytest.mark.parametrize(
    ("exceeds", "told"),
    [
        ("{soft_grip: {gain: 0.9}}", "exceeds.soft_grip.gain is unknown; known are force_gain, "),
        ("{soft_grip: {force_gain: .nan}}", "exceeds.soft_grip.force_gain = nan: a finite number"),
        ("{soft_grip: 0.9}", "exceeds.soft_grip = 0.9: dict is wanted"),
        ("[soft_grip]", "exceeds = .*: dict is wanted"),
    ],
)
def test_what_they_exceed_must_be_gains(tmp_path, exceeds, told):
    with pytest.raises(SettingError, match=told):
        load_gain_limits(written(tmp_path, exceeds=exceeds), SERIAL)


def test_a_load_that_is_left_out_is_missed(tmp_path):
    hand_and_arm = LARGEST.partition("  wall")[0]
    with pytest.raises(SettingError, match="largest_gains_on.wall is missing"):
        load_gain_limits(written(tmp_path, hand_and_arm), SERIAL)


@pytest.mark.parametrize(
    ("gains", "told"),
    [
        ((6.28, 12.6), "force_gain 6.28 (soft grip 0.92, light wall 0.07), "
                       "observer_gain 12.6 (soft grip 0.51)"),
        ((0.5, 0.5), "force_gain 0.5 (light wall 0.07)"),
        ((0.07, 0.51), ""),
        ((9.6, 0.0), "force_gain 9.6 (heavy arm 6.28, wall 9.5, soft grip 0.92, light wall 0.07)"),
    ],
)  # fmt: skip
def test_it_says_on_which_loads_gains_are_unstable_in_its_own_model(tmp_path, gains, told):
    """A "certificate" permitted 3.5 where the same file had 0.92 for a soft grip."""
    limits = load_gain_limits(written(tmp_path), SERIAL)
    law = LAW._replace(force_gain=gains[0], observer_gain=gains[1])
    assert limits.exceeded(law) == told


def old_file(folder, gains="{force_gain: 6.28, observer_gain: 12.6}", law=""):
    """Write a file as the last release did, a certificate; return its path."""
    return signed(
        folder / "module_certificate.yaml",
        f"format: screw_module_ros/certificate\nversion: 1\nserial: {SERIAL}\n"
        f"date: '2026-11-22T09:30:00Z'\n{law}permitted_gains: {gains}\n",
        CONDITIONS,
    )


@pytest.mark.parametrize("law", ["law: 0123456789ab\n", ""])
def test_a_certificate_of_the_last_release_limits_and_permits_nothing(tmp_path, law):
    """Its law was a digest of files, or none: whether it is this law nobody can tell."""
    limits = load_gain_limits(old_file(tmp_path, law=law), SERIAL)
    assert limits.largest == (6.28, 12.6)
    assert limits.chosen(LAW._replace(force_gain=9.0)).force_gain == 6.28
    assert "6.28 at most" in limits.refusal(
        LAW._replace(force_gain=9.0), modes.FORCE_FEEDBACK, RATE
    )
    told = limits.feedback_refusal
    assert re.search("cannot be compared.*run stability and .*module_gain_limits", told)
    assert not load_gain_limits(written(tmp_path), SERIAL).feedback_refusal


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("force_gain: 6", "force_gain: 9"), "sha256: the file was changed"),
        (("{force_gain: 6.28, ", "{"), "permitted_gains.force_gain is missing"),
        (("permitted_gains", "largest_gains_on"), "largest_gains_on is unknown"),
        (("version: 1", "version: 2"), "'screw_module_ros/certificate' and 1 are wanted"),
    ],
)
def test_a_certificate_with_a_mistake_is_refused_by_its_own_keys(tmp_path, change, told):
    file = old_file(tmp_path)
    file.write_text(file.read_text().replace(*change, 1))
    with pytest.raises(SettingError, match=told):
        load_gain_limits(file, SERIAL)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(SettingError, match="cannot be read"):
        load_gain_limits(tmp_path / "none.yaml", SERIAL)
