# SPDX-License-Identifier: Apache-2.0
"""A therapist's limits of stiffness and workspace are applied before the session."""

from __future__ import annotations

import pytest
import yaml

from screw_module_ros.settings import SettingError
from screw_module_ros.therapy.protocol_file import (
    SHIPPED,
    AssistanceLimits,
    allowed_protocol,
    as_yaml,
    limited,
    load_protocol,
    parse_protocol,
    protocol_text,
)
from screw_module_ros.therapy.session import Session
from screw_module_ros.therapy.wishes import WishGate, WishLimits

WORKSPACE = WishLimits()


@pytest.mark.parametrize("name", SHIPPED)
def test_without_limits_a_protocol_is_what_its_file_says(name):
    protocol, text = allowed_protocol(protocol_text(name), name, AssistanceLimits(), WORKSPACE)
    assert protocol == load_protocol(name)
    assert text == protocol_text(name)


@pytest.mark.parametrize("name", SHIPPED)
@pytest.mark.parametrize("stiffest", [0.0, 30.0, 120.0])
def test_no_wall_is_stiffer_than_allowed(name, stiffest):
    limits = AssistanceLimits(stiffest)
    protocol, text = allowed_protocol(protocol_text(name), name, limits, WORKSPACE)
    guidance, rules = protocol.guidance, protocol.rules
    walls = [guidance.back_stiffness, guidance.side_stiffness, rules.prepare_stiffness]
    walls += [block.stiffness for block in protocol.blocks]
    if protocol.adaptation is not None:
        walls += [protocol.adaptation.softest, protocol.adaptation.stiffest]
    assert max(walls) <= stiffest
    assert parse_protocol(text, name) == protocol  # what is recorded is what is done
    assert Session(protocol).assistance.side_stiffness <= stiffest
    original = load_protocol(name)
    assert protocol.blocks[0].targets == original.blocks[0].targets
    assert protocol.guidance.duration == original.guidance.duration


@pytest.mark.parametrize("name", SHIPPED)
@pytest.mark.parametrize("stiffest", [30.0, 300.0, 500.0])
def test_a_wall_that_stiffens_over_time_stays_below_the_limit(name, stiffest):
    protocol, _ = allowed_protocol(
        protocol_text(name), name, AssistanceLimits(stiffest), WORKSPACE
    )
    guidance, rules = protocol.guidance, protocol.rules
    shortest = protocol.adaptation.shortest if protocol.adaptation else guidance.duration
    for stiffness, growth, growing in (
        (guidance.back_stiffness, guidance.growth, rules.give_up - shortest),
        (rules.prepare_stiffness, rules.prepare_growth,
         rules.prepare_limit - rules.prepare_duration),
    ):  # fmt: skip
        assert stiffness + growth * growing <= stiffest
    assert rules.hold_stiffness <= stiffest


@pytest.mark.parametrize("bounds", [{"shortest": 0.9}, {}, {"stiffest": 250.0}])
def test_bounds_that_a_protocol_leaves_out_are_limited_too(bounds):
    content = yaml.safe_load(protocol_text("clock_adaptive"))
    content["adaptation"] = bounds
    text = yaml.safe_dump(content)
    protocol, _ = allowed_protocol(text, "own", AssistanceLimits(50.0), WORKSPACE)
    assert protocol.adaptation.stiffest == 50.0


def test_no_stiffness_grows_neither():
    protocol = limited(load_protocol("clock_adaptive"), 0.0)
    assert (protocol.guidance.growth, protocol.rules.prepare_growth) == (0.0, 0.0)


@pytest.mark.parametrize("name", SHIPPED)
@pytest.mark.parametrize("stiffest", [0.0, 33.3, 800.0])
def test_a_protocol_survives_its_yaml(name, stiffest):
    protocol = limited(load_protocol(name), stiffest)
    assert parse_protocol(as_yaml(protocol), name) == protocol


@pytest.mark.parametrize(("workspace", "name", "told"), [
    (WishLimits(half_width=0.10), "clock_adaptive", "x = -0.140 m"),
    (WishLimits(half_depth=0.05), "clock_adaptive", "y = 0.099 m"),
    (WishLimits(high=0.30), "elevator", "z = 0.320 m"),
    (WishLimits(low=0.05), "elevator", "z = 0.040 m"),
    (WishLimits(high=0.20), "reach_3d", "z = 0.260 m"),
])  # fmt: skip
def test_a_target_outside_the_workspace_is_refused(workspace, name, told):
    with pytest.raises(ValueError, match="widen it, or choose another") as error:
        allowed_protocol(protocol_text(name), name, AssistanceLimits(), workspace)
    assert told in str(error.value)


def test_axes_a_protocol_does_not_use_do_not_count():
    narrow = WishLimits(half_width=0.0, half_depth=0.0)
    flat = WishLimits(low=0.0, high=0.0)
    for name, limits in (("elevator", narrow), ("clock_adaptive", flat)):
        assert allowed_protocol(protocol_text(name), name, AssistanceLimits(), limits)


def test_what_is_no_protocol_is_told_as_such():
    with pytest.raises(SettingError):
        allowed_protocol("dance: true", "dance", AssistanceLimits(10.0), WORKSPACE)


def test_a_game_that_has_gone_lets_the_hand_go_once():
    gate, hand = WishGate(WishLimits()), (0.05, 0.0, 0.2)
    assert gate.released(hand, 10**12) is None  # nobody has wished
    gate.passed((0.1, 0.0, 0.2), hand, 0)
    assert gate.released(hand, 900_000_000) is None
    assert gate.released(hand, 1_000_000_000) == hand
    assert gate.released(hand, 5_000_000_000) is None
    moved = (-0.1, 0.0, 0.2)
    assert gate.passed((0.1, 0.0, 0.2), moved, 6_000_000_000)[0] == pytest.approx(-0.04)


def test_limits_of_wishes_change_while_wishes_come():
    gate = WishGate(WishLimits(speed=0.6))
    hand = (0.0, 0.0, 0.18)
    for step in range(100):
        passed = gate.passed((1.0, -1.0, 1.0), hand, step * 200_000_000)
    assert passed == pytest.approx((0.15, -0.15, 0.33))
    gate.limits = WishLimits(half_width=0.05, half_depth=0.02, low=0.2, high=0.1, speed=0.6)
    assert gate.passed((1.0, -1.0, 1.0), hand, 100 * 200_000_000) == pytest.approx(
        (0.05, -0.02, 0.1)
    )


@pytest.mark.parametrize(("side", "x"), [("left", -0.03), ("right", 0.03), ("", 0.03)])
def test_a_layout_beside_the_middle_is_mirrored_for_the_left_arm(side, x):
    """What is recorded is what is carried out; a layout in the middle stays the file's own text."""
    text = as_yaml(load_protocol("reach_3d")._replace(centre=(0.03, 0.0, 0.18)))
    wide = WishLimits(half_width=0.19)
    protocol, definition = allowed_protocol(text, "test", AssistanceLimits(), wide, side)
    assert protocol.centre == (x, 0.0, 0.18)
    assert parse_protocol(definition, "test") == protocol
    middle = as_yaml(load_protocol("reach_3d"))
    assert allowed_protocol(middle, "test", AssistanceLimits(), wide, side)[1] == middle
