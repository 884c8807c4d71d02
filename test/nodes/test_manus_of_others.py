# SPDX-License-Identifier: Apache-2.0
"""`manus` with a law and an arm of other packages: their parameters, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, NamedTuple

import pytest

from screw_module_ros.control.arms import FIVE_BAR
from screw_module_ros.control.law import Law, Variant
from screw_module_ros.control.plane_law import PlaneLaw
from screw_module_ros.settings import Setting, SettingError


class Own(NamedTuple):
    """Settings of a law."""

    gain: Annotated[float, Setting("of nothing", "", 0.0, 5.0, live=True)] = 1.0


def too_much(own):
    """Refuse a gain beyond 3."""
    return f"plain.gain = {own.gain:g} is too much" if own.gain > 3.0 else ""


PLAIN = PlaneLaw("plain", Own, refusal=too_much)
TAKEN, JOINT = PlaneLaw("joints", Own), PlaneLaw("shoulder", Own)
HEEDS = PlaneLaw("heeds", Own, heeds=True)
VERTICAL = Law("vertical", {100: Variant("V")}, Own)
TURNED = replace(
    FIVE_BAR, name="turned", jacobian=lambda s, e, own: FIVE_BAR.jacobian(e, s, own)
)


def given(name: str) -> str:
    """Return the path of an object in this file."""
    return f"{__name__}:{name}"


def test_settings_of_a_law_are_parameters_below_its_name(make_node):
    node = make_node("manus", "-p", f"law:={given('PLAIN')}", "-p", "plain.gain:=2.0")
    assert node.get_parameter("plain.gain").value == 2.0
    assert node.parameters.write(**{"plain.gain": 2.5}) == ""
    assert "plain.gain = 4 is too much" in node.parameters.write(**{"plain.gain": 4.0})


@pytest.mark.parametrize(
    ("law", "said"),
    [
        ("no_law", "law no_law: neither package.module:NAME nor an entry point"),
        (given("TAKEN"), "law joints: this node has parameters of that name: rename it"),
        (given("JOINT"), "law shoulder: this node has parameters of that name: rename it"),
        (given("HEEDS"), "it heeds the guard by itself"),
        (given("VERTICAL"), "is a law of the vertical axis: for `laws` of impedance_controller"),
        (given("TURNED"), "is no screw_module_ros.control.plane_law.PlaneLaw"),
    ],
)
def test_what_is_no_law_of_the_plane_is_refused_at_the_start(make_node, law, said):
    with pytest.raises(SettingError, match=said.replace(".", r"\.")):
        make_node("manus", "-p", f"law:={law}")


def test_settings_that_a_law_refuses_are_refused_at_the_start_too(make_node):
    node = make_node("manus", "-p", f"law:={given('PLAIN')}", "-p", "plain.gain:=4.0")
    with pytest.raises(ValueError, match="plain.gain = 4 is too much"):
        node.connect()


def test_an_arm_brings_its_settings_and_the_limits_of_its_joints(make_node, importing):
    importing("own_arm", "serial_arm")
    node = make_node("manus", "-p", "arm:=serial_arm:SERIAL", "-p", "arm.upper:=0.4")
    assert node.get_parameter("arm.upper").value == 0.4
    assert node.get_parameter("elbow_low").value == -2.6
    assert not node.has_parameter("arm.upper_arm")


def test_an_arm_whose_functions_do_not_fit_together_is_refused_before_any_device(make_node):
    node = make_node("manus", "-p", f"arm:={given('TURNED')}")
    with pytest.raises(SettingError, match="arm turned: at x, y = .* its jacobian is not how its"):
        node.connect()


def test_an_arm_that_does_not_reach_the_mark_names_its_own_numbers(make_node, importing):
    importing("own_arm", "serial_arm")
    node = make_node("manus", "-p", "arm:=serial_arm:SERIAL", "-p", "joints.home_y:=-0.5")
    with pytest.raises(SettingError, match=r"not reach there; its own are arm\.upper, arm\.fore"):
        node.connect()
