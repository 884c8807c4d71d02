# SPDX-License-Identifier: Apache-2.0
"""Laws of other packages: what is taken, and the sentence for what is not."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from importlib import metadata
from typing import NamedTuple

import pytest

from screw_module_ros import plugins
from screw_module_ros.calibration.version import law_version
from screw_module_ros.control import laws
from screw_module_ros.control.envelope import enveloped, initial_state
from screw_module_ros.control.law import Law, Variant, pulls
from screw_module_ros.control.vertical import VerticalInput
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.settings import SettingError


class Own(NamedTuple):
    """Settings of a law."""

    gain: float = 1.0


MINE = Law("mine", {100: Variant("MINE", ("gain",))}, Own)
OTHER = Law("mine", {100: Variant("OTHER")}, Own)
SAME_MODE = Law("another", {100: Variant("ANOTHER")}, Own)
NO_LAW = 3.0


def path(name: str) -> str:
    """Return the path of a law in this file."""
    return f"{__name__}:{name}"


def test_a_law_is_found_by_module_and_name_and_by_entry_point(monkeypatch):
    assert laws.load(path("MINE")) is MINE
    point = metadata.EntryPoint("floor", path("MINE"), laws.GROUP)
    monkeypatch.setattr(plugins, "entry_points", lambda group: [point])
    assert laws.load("floor") is MINE


@pytest.mark.parametrize(
    ("named", "said"),
    [
        ("floor", "neither package.module:NAME nor an entry point of screw_module_ros.laws"),
        ("no_such_module:LAW", "no_such_module:LAW: ModuleNotFoundError: No module named"),
        (path("MISSING"), "AttributeError: module .* has no attribute 'MISSING'"),
        (path("NO_LAW"), "is no screw_module_ros.control.law.Law"),
    ],
)
def test_what_is_no_law_is_told_in_a_sentence(named, said):
    with pytest.raises(SettingError, match=said) as caught:
        laws.load(named)
    assert str(caught.value).startswith(f"law {named}: ")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"name": "my law"}, "'my law', is also the prefix of its parameters"),
        ({"variants": {7: Variant("SEVEN")}}, "those of other packages are 100 to 199"),
        ({"name": "self"}, "is also the prefix of its parameters"),
        ({"ask": None}, "its ask is no function"),
        ({"variants": [100]}, "are no dict of numbers to Variant"),
        ({"variants": {"100": Variant("A")}}, "are no dict of numbers to Variant"),
        ({"variants": {100: "A"}}, "a Variant with a tuple of gains is wanted"),
        ({"variants": {100: Variant("A", "gain")}}, "a Variant with a tuple of gains is wanted"),
        ({"variants": {100: Variant("IMPEDANCE")}}, "the name of a mode of this package"),
        ({"settings": VerticalSettings}, "are those of a law of this package"),
        ({"settings": Own()}, "its settings are no NamedTuple"),
        ({"variants": {}}, "those of other packages are 100 to 199"),
        ({"variants": {100: Variant("A"), 102: Variant("B")}}, "they must follow each other"),
        ({"heeds": True}, "the envelope does that"),
        ({"settings": dict}, "its settings are no NamedTuple"),
        ({"settings": NamedTuple("Bare", [("gain", float)])}, "its setting gain has no default"),
        ({"shown": tuple("abcdefghi")}, "is no tuple of 8 names at most"),
        ({"variants": {100: Variant("A", ("force",))}}, "its gain force is none of its settings"),
    ],
    ids=str,
)
def test_a_law_that_others_may_not_bring_is_refused(change, said):
    assert not laws.flaw(MINE)
    assert said in laws.flaw(replace(MINE, **change))


@pytest.mark.parametrize(
    ("second", "said"),
    [("OTHER", "another one is called mine too"), ("SAME_MODE", "mode 100 is mine's")],
)
def test_two_laws_with_one_name_or_mode_are_refused(second, said):
    assert laws.loaded(["", path("MINE")]) == (*laws.LAWS, MINE)
    with pytest.raises(SettingError, match=said):
        laws.loaded([path("MINE"), path(second)])


def test_an_error_in_a_law_s_own_refusal_is_its_refusal():
    def objects(settings, mode):
        raise ZeroDivisionError("no such gain")

    assert laws.refusal(MINE, Own(), 100) == ""
    assert laws.refusal(replace(MINE, refusal=lambda settings, mode: None), Own(), 100) == ""
    assert "no sentence" in laws.refusal(replace(MINE, refusal=lambda s, mode: True), Own(), 100)
    said = laws.refusal(replace(MINE, refusal=objects), Own(), 100)
    assert said == "law mine: refusal: ZeroDivisionError: no such gain"


def test_the_version_of_a_law_of_others_is_its_source_and_the_envelope():
    version = law_version(replace(MINE, ask=lambda own, m, sample, motion: pulls(1.0)))
    assert len(version) == 12 and version != law_version() != law_version(MINE)
    assert law_version(replace(MINE, ask=partial(max, 1.0))) == "unknown", "it is no Python"


def test_a_law_without_functions_is_the_robot_s_spring():
    settings, own = VerticalSettings(stiffness=200.0), Own()
    step, memory = enveloped(MINE), initial_state(settings, MINE, own)
    inp = VerticalInput(100, 0.10, 0.0, 0.0, 0.13, 0.0, True)
    for _ in range(3000):
        output = step(settings, own, memory, inp, 1e-3)
    assert output.force == pytest.approx(200.0 * 0.03 + settings.gravity)
    assert math.isclose(output.impedance, 6.0, rel_tol=1e-6)
