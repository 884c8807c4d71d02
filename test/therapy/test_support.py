# SPDX-License-Identifier: Apache-2.0
"""Support of the arm's weight: what is refused, by hand and in the blocks of a protocol."""

from __future__ import annotations

import math

import pytest
import yaml

from screw_module_ros.settings import SettingError, plain
from screw_module_ros.therapy.protocol_file import parse_protocol, protocol_text
from screw_module_ros.therapy.support import (
    NO_FEEDBACK,
    BlockSupport,
    Carried,
    Fade,
    block_refusal,
    refusal,
)

UNKNOWN = math.nan


@pytest.mark.parametrize(("force", "weight", "limit", "told"), [
    (0.0, UNKNOWN, None, ""),
    (0.0, UNKNOWN, 0.0, ""),
    (5.0, 12.0, None, "controller, which is silent"),
    (5.0, 12.0, 0.0, NO_FEEDBACK),
    (-5.0, 12.0, 0.0, NO_FEEDBACK),
    (8.0, 20.0, 8.0, ""),
    (8.1, 20.0, 8.0, "at most 8 N of support, or set its stop_reaction to brake"),
    (-20.0, UNKNOWN, 8.0, "stop_reaction to brake"),
    (-20.0, UNKNOWN, 25.0, ""),
    (15.0, UNKNOWN, 25.0, ""),
    (15.1, UNKNOWN, 25.0, "the arm was not weighed: at most 15 N"),
    (14.0, 12.0, 25.0, ""),
    (14.1, 12.0, 25.0, "the arm weighs 12.0 N: at most 14.0 N"),
    (25.0, 24.0, 25.0, ""),
])  # fmt: skip
def test_each_bound_has_its_sentence(force, weight, limit, told):
    found = refusal(force, weight, limit)
    assert (told in found) if told else not found


FADING = BlockSupport(share=1.0, fade=Fade(to=-0.25, step=0.5, after=0.8, back=0.5))
MANY, SOME, FEW = [True] * 4, [True, True, True, False], [False] * 3 + [True]


def test_a_share_fades_by_success_alone_and_comes_back():
    carried = Carried(FADING, 12.0)
    assert carried.force == 12.0
    circuits = (MANY, SOME, MANY, MANY, MANY, FEW, FEW, FEW, FEW)
    found = [carried.judge(reached) for reached in circuits]
    forces = [12.0, 6.0, 6.0, 0.0, -3.0, -3.0, 3.0, 9.0, 12.0, 12.0]
    assert [before for before, _, _ in found] == forces[:-1]
    assert [after for _, after, _ in found] == forces[1:]
    assert found[0][2] == "support 100% to 50% of the weight, as 4 of 4 were reached"
    assert found[1][2] == "support still 50% of the weight, as 3 of 4 were reached"


def test_a_support_by_hand_ends_the_fade_and_is_told_once():
    carried = Carried(FADING, 12.0)
    carried.set_by_hand(9.0)
    carried.set_by_hand(7.5)
    assert carried.force == 7.5
    assert carried.judge(MANY) == (12.0, 7.5, "support by hand from now on")
    assert carried.judge(MANY) is None and carried.force == 7.5


def test_what_does_not_fade_is_not_judged():
    assert Carried(BlockSupport(force=-5.0), UNKNOWN).force == -5.0
    assert Carried(BlockSupport(share=-1.0), 24.0).force == -20.0, "no more than there is"
    assert Carried(None, 12.0, 7.0).force == 7.0, "as it was"
    for block in (None, BlockSupport(share=0.5)):
        carried = Carried(block, 12.0)
        carried.set_by_hand(3.0)
        assert carried.judge(FEW) is None and carried.force == 3.0


@pytest.mark.parametrize(("support", "told"), [
    ({}, "either share or force"),
    ({"share": 0.5, "force": 5.0}, "either share or force"),
    ({"share": 1.2}, "share"),
    ({"force": 5.0, "fade": {"to": 0.0, "step": 0.1, "after": 0.8, "back": 0.5}}, "no force"),
    ({"share": 1.0, "fade": plain(FADING.fade) | {"back": 0.8}}, "less than after"),
])  # fmt: skip
def test_a_block_s_support_that_cannot_be_is_refused(support, told):
    content = yaml.safe_load(protocol_text("clock_adaptive"))
    content["blocks"][0]["support"] = support
    with pytest.raises(SettingError, match=told):
        parse_protocol(yaml.safe_dump(content), "own")


def test_only_reaches_fade():
    content = yaml.safe_load(protocol_text("lift"))
    content["blocks"][1]["support"] = plain(FADING)
    with pytest.raises(SettingError, match="only reaches succeed or not, a circle does not"):
        parse_protocol(yaml.safe_dump(content), "own")


@pytest.mark.parametrize(("block", "weight", "limit", "told"), [
    (None, UNKNOWN, None, ""),
    (BlockSupport(share=0.5), UNKNOWN, 25.0, "weigh the arm first"),
    (BlockSupport(share=0.5), 12.0, 25.0, ""),
    (BlockSupport(share=0.5), 20.0, 8.0, "stop_reaction to brake"),
    (BlockSupport(force=10.0), UNKNOWN, 0.0, "choose mode 3 to 5"),
])  # fmt: skip
def test_a_session_whose_support_must_not_be_does_not_start(block, weight, limit, told):
    found = block_refusal(block, weight, limit)
    assert (told in found) if told else not found
