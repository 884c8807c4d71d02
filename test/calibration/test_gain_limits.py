# SPDX-License-Identifier: Apache-2.0
"""A module's gain limits: what they limit, what they exceed, and what is refused."""

import math
import re
from dataclasses import replace
from typing import Annotated, NamedTuple

import pytest
import yaml

from screw_module_ros.calibration.gain_limits import (
    Loop,
    conditions_of,
    load_gain_limits,
)
from screw_module_ros.calibration.limits_file import GainLimitsSettings, text_checksum
from screw_module_ros.calibration.selection import chosen_gain_limits
from screw_module_ros.calibration.version import known_laws, law_version
from screw_module_ros.control import modes
from screw_module_ros.control.law import LINEAR, Law, Margin, Variant
from screw_module_ros.control.laws import margin_of
from screw_module_ros.control.laws.thesis import THESIS
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.settings import Setting, SettingError

SERIAL = "ARM-0007"


RATE = 1000.0
LAW = VerticalSettings(mass=5.437218, observer_inertia=0.35)
CONDITIONS = conditions_of(THESIS, LAW, LAW, Loop(RATE, 1.26e-3, 30.0))
LEAST, MOST = ({m.gain: getattr(m, side) for m in THESIS.margins} for side in ("least", "most"))


LARGEST = """
  hand: {force_gain: 14.1, observer_gain: 23}
  heavy_arm: {force_gain: 6.28, observer_gain: 16}
  wall: {force_gain: 9.5, observer_gain: 12.6}
"""
EXCEEDS = "{soft_grip: {force_gain: 0.92, observer_gain: 0.51}, light_wall: {force_gain: 0.07}}"


def written(
    folder, largest=LARGEST, exceeds=EXCEEDS, serial=SERIAL, conditions=CONDITIONS, law=None,
    named="thesis",
):
    """Write a file of gain limits; return its path."""
    of_law = {
        "version": law or law_version(), "largest_gains_on": yaml.safe_load(largest),
        "exceeds": yaml.safe_load(exceeds),
    } | ({"conditions": conditions} if conditions else {})  # fmt: skip
    return signed(
        folder / "module_gain_limits.yaml",
        f"format: screw_module_ros/gain_limits\nversion: 3\nserial: {serial}\n"
        "date: '2026-11-22T09:30:00Z'\n"
        + yaml.safe_dump({"laws": {named: of_law}}, sort_keys=False),
        None,
    )


def written_before(folder, law=None):
    """Write a file as software did before it knew laws by name; return its path."""
    return signed(
        folder / "module_gain_limits.yaml",
        f"format: screw_module_ros/gain_limits\nversion: 2\nserial: {SERIAL}\n"
        f"date: '2026-11-22T09:30:00Z'\nlaw: '{law or law_version()}'\n"
        f"largest_gains_on: {LARGEST}\nexceeds: {EXCEEDS}\n",
        CONDITIONS,
    )


def signed(file, text, conditions):
    """Write a text with conditions and checksum; return the path."""
    text += yaml.safe_dump({"conditions": conditions}) if conditions else ""
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
    most = limits.laws["thesis"].largest[field]
    at_most = LAW._replace(**{field: most})
    beyond = at_most._replace(**{field: most + 0.01})
    assert not refused(limits, at_most, mode)
    assert re.search(f"{field} is .*ARM-0007.* at most", refused(limits, beyond, mode))
    assert not refused(limits, beyond, modes.IMPEDANCE)


def refused(limits, law, mode, rate=RATE):
    """Return why settings of the law of modes 1 to 5 go beyond limits."""
    return limits.refusal(THESIS, mode, law, law, rate)


def departed(name, share):
    """Return law and rate with one condition of the limits times a share."""
    if name == "rate":
        return LAW, RATE * share
    return LAW._replace(**{name: share * getattr(LAW, name)}), RATE


@pytest.mark.parametrize("mode", [modes.FORCE_FEEDBACK, modes.COMBINED, modes.OBSERVER])
@pytest.mark.parametrize(
    ("names", "name"),
    [(side, name) for side in (LEAST, MOST) for name in dict.fromkeys(sum(side.values(), ()))],
)
def test_a_condition_that_costs_margin_is_refused_in_the_modes_it_matters_in(
    tmp_path, mode, names, name
):
    """With 30 Hz in place of 9 the gain that is stable on a heavy arm falls from 16 to 5."""
    limits = load_gain_limits(written(tmp_path), SERIAL)
    worse, better = (0.999, 1.001) if names is LEAST else (1.001, 0.999)
    for share in (1.0,) if name == "rate" else (1.0, better):
        law, rate = departed(name, share)
        assert not refused(limits, law, mode, rate)
    law, rate = departed(name, worse)
    told = refused(limits, law, mode, rate)
    gain = "observer_gain" if mode == modes.OBSERVER else "force_gain"
    if name in names[gain]:
        limit = "at least" if names is LEAST else "at most"
        wanted = CONDITIONS[name]
        assert re.search(f"{name} is .*ARM-0007.* {wanted:.10g}.* {limit}.*beyond_gain", told)
    else:
        assert not told
    assert not refused(limits, law, modes.IMPEDANCE, rate)


def test_limits_without_their_conditions_are_refused(tmp_path):
    with pytest.raises(SettingError, match="conditions is missing.*run stability"):
        load_gain_limits(written(tmp_path, conditions=None), SERIAL)
    with pytest.raises(SettingError, match="conditions.delay = nan: a finite number"):
        load_gain_limits(written(tmp_path, conditions=CONDITIONS | {"delay": math.nan}), SERIAL)


def test_limits_for_another_version_of_the_law_are_refused(tmp_path):
    with pytest.raises(SettingError, match="version 0123456789ab of law thesis.* run stability"):
        load_gain_limits(written(tmp_path, law="0123456789ab"), SERIAL)
    with pytest.raises(SettingError, match="version 0123456789ab of law thesis.* run stability"):
        load_gain_limits(written_before(tmp_path, "0123456789ab"), SERIAL)


@pytest.mark.parametrize("version", [law_version(), *known_laws()["thesis"].formerly])
def test_a_file_measured_before_laws_had_names_stays_good(tmp_path, version):
    """The same runs, bit for bit, had several versions while the version was that of a source."""
    limits = load_gain_limits(written_before(tmp_path, version), SERIAL)
    assert not limits.feedback_refusal(THESIS)
    now = load_gain_limits(written(tmp_path), SERIAL)
    assert limits.laws["thesis"]._replace(version="") == now.laws["thesis"]._replace(version="")


@pytest.mark.parametrize(
    ("change", "serial", "told"),
    [
        (("force_gain: 6.28", "force_gain: 9.28"), SERIAL, "sha256: the file was changed"),
        (("version: 3", "version: 1"), SERIAL, "version = 1: .* and 3 are wanted"),
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
        ("[6.28, 12.6]", "largest_gains_on.hand = .*: dict is wanted"),
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
    assert limits.exceeded(THESIS, law) == told


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
    assert limits.laws["thesis"].largest == {"force_gain": 6.28, "observer_gain": 12.6}
    assert limits.chosen(THESIS, LAW._replace(force_gain=9.0)).force_gain == 6.28
    assert "6.28 at most" in refused(limits, LAW._replace(force_gain=9.0), modes.FORCE_FEEDBACK)
    told = limits.feedback_refusal(THESIS)
    assert re.search("cannot be compared.*run stability and .*module_gain_limits", told)
    assert not load_gain_limits(written(tmp_path), SERIAL).feedback_refusal(THESIS)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("force_gain: 6", "force_gain: 9"), "sha256: the file was changed"),
        (("{force_gain: 6.28, ", "{"), "permitted_gains.force_gain is missing"),
        (("permitted_gains", "largest_gains_on"), "permitted_gains = None: dict is wanted"),
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


class Own(NamedTuple):
    """Settings of a law of another package."""

    gain: Annotated[float, Setting("of the hand's force", "", 0.0, 10.0)] = 1.5
    stiffness: Annotated[float, Setting("of its floor", "N/m", 0.0, 3e3)] = 800.0


FLOOR = Law("floor", {100: Variant("FLOOR", ("gain",)), 101: Variant("BARE")}, Own, judged=LINEAR)
OF_FLOOR = conditions_of(FLOOR, LAW, Own(), Loop(RATE, 1.26e-3, 30.0))
ON = "{hand: {gain: 3.0}, heavy_arm: {gain: 2.5}, wall: {gain: 4.0}}"


@pytest.fixture
def of_floor(tmp_path):
    """Gain limits of a law of another package alone."""
    return load_gain_limits(
        written(tmp_path, ON, "{soft_grip: {gain: 0.5}}", conditions=OF_FLOOR,
                law=law_version(FLOOR), named="floor"), SERIAL
    )  # fmt: skip


def test_gains_of_a_law_of_another_package_are_limited_by_the_law_s_own_name(of_floor):
    assert not of_floor.feedback_refusal(FLOOR)
    assert of_floor.chosen(FLOOR, Own(gain=9.0)) == Own(gain=2.5)
    told = of_floor.refusal(FLOOR, 100, LAW, Own(gain=2.6), RATE)
    assert re.search("floor.gain is 2.6, .*ARM-0007.* are 2.5 at most", told)
    assert not of_floor.refusal(FLOOR, 100, LAW, Own(gain=2.5), RATE)
    assert not of_floor.refusal(FLOOR, 101, LAW, Own(gain=2.6), RATE), "this mode does not use it"
    assert of_floor.exceeded(FLOOR, Own()) == "gain 1.5 (soft grip 0.5)"
    assert "no gain limits of law thesis" in of_floor.feedback_refusal(THESIS)


@pytest.mark.parametrize(
    ("law", "own", "rate", "told"),
    [
        (LAW, Own(stiffness=900.0), RATE, "floor.stiffness is 900 N/m.* 800 N/m at most"),
        (LAW, Own(stiffness=700.0), RATE, "floor.stiffness is 700 N/m.* 800 N/m at least"),
        (LAW._replace(force_cutoff=29.0), Own(), RATE, "force_cutoff is 29 Hz.* 30 Hz at least"),
        (LAW._replace(stiffness=900.0), Own(), RATE, ""),
        (LAW, Own(), 2000.0, "rate is 2000 Hz.* 1000 Hz at most"),
    ],
)
def test_a_gain_without_a_margin_is_limited_for_the_settings_it_was_found_with(
    of_floor, law, own, rate, told
):
    found = of_floor.refusal(FLOOR, 100, law, own, rate)
    assert re.search(told, found) if told else not found


def test_a_law_says_itself_on_what_its_limits_depend(of_floor):
    """Then what it does not name may change, and what it names in one direction alone."""
    stiffer = replace(FLOOR, margins=(Margin("gain", "floor", (), ("stiffness",)),))
    assert margin_of(stiffer, "gain").name == "floor"
    limits = of_floor.laws["floor"]
    assert limits.departure(stiffer, "gain", LAW, Own(stiffness=900.0), RATE)
    assert not limits.departure(stiffer, "gain", LAW, Own(stiffness=700.0), 2000.0)


def test_limits_of_another_version_of_somebody_s_law_are_told_when_they_are_needed(tmp_path):
    """The robot starts all the same: a law of others changes every day."""
    file = written(tmp_path, ON, "{}", conditions=OF_FLOOR, law="0123456789ab", named="floor")
    limits = load_gain_limits(file, SERIAL)
    assert re.search("version 0123456789ab of the law, .*stability", limits.feedback_refusal(FLOOR))
    assert limits.chosen(FLOOR, Own(gain=9.0)) == Own(gain=9.0), "they are of no use"


@pytest.mark.parametrize(
    ("largest", "conditions", "told"),
    [
        (ON.replace("gain", "again"), OF_FLOOR, "hand.again is unknown; known are gain"),
        (ON, OF_FLOOR | {"floor.height": 1.0}, "conditions.floor.height is unknown"),
        (ON, {**OF_FLOOR, "floor.stiffness": "stiff"}, "floor.stiffness = 'stiff': a number"),
        (ON.replace("4.0", "40.0"), OF_FLOOR, "wall.gain = 40.0: above the largest allowed, 10"),
    ],
)
def test_limits_that_do_not_fit_somebody_s_law_are_told_with_their_key(
    tmp_path, largest, conditions, told
):
    file = written(
        tmp_path, largest, "{}", conditions=conditions, law=law_version(FLOOR), named="floor"
    )
    assert told in load_gain_limits(file, SERIAL).feedback_refusal(FLOOR)
