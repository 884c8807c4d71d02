# SPDX-License-Identifier: Apache-2.0
"""Support of the arm's weight: what is refused, how the arm is lowered, when it pulls hard."""

from __future__ import annotations

import math

import pytest

from screw_module_ros.therapy.hand import HandSample
from screw_module_ros.therapy.support import NO_FEEDBACK, Spasm, Support, refusal

S = 1_000_000_000
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


def test_a_weighing_bounds_what_was_asked_for_before():
    support = Support()
    support.ask(15.0)
    support.weight = 8.0
    assert support.force == 10.0
    support.weight = 20.0
    assert support.force == 15.0


def test_an_arm_is_lowered_first_and_let_go_then():
    support = Support()
    support.ask(12.0)
    support.in_use = 12.0
    support.lower(0.2, 0.05, 10 * S)
    slot, start_ns = support.lowering.vertical, support.lowering.start_ns
    assert (slot.start_x, slot.target_x, slot.duration) == (0.2, 0.05, 4.0)
    assert start_ns == 10 * S and support.lowering.plane is None and slot.validated()
    for second in range(10, 15):
        support.follow(second * S)
        assert support.force == 12.0 and support.lowering, "it hangs on its support on the way"
    support.follow(15 * S)
    assert support.force == 0.0
    assert support.lowering, "the support still goes, and the slot must not let it fall meanwhile"
    support.in_use = 0.4
    support.follow(16 * S)
    assert support.lowering is None


def test_an_arm_below_its_rest_is_not_lifted():
    support = Support()
    support.lower(0.03, 0.05, S)
    assert support.lowering.vertical.target_x == 0.03


def test_what_goes_on_carries_the_arm_again():
    support = Support()
    support.ask(12.0)
    support.lower(0.2, 0.05, S)
    support.follow(10 * S)
    assert (support.force, support.lowering) == (0.0, None)
    support.carry_on()
    assert support.force == 12.0
    support.lower(0.2, 0.05, 20 * S)
    support.ask(3.0)
    assert support.lowering is None, "by hand it ends"
    support.carry_on()
    assert support.force == 3.0


def test_a_lowering_that_is_stopped_leaves_the_arm_carried():
    support = Support()
    support.ask(12.0)
    support.lower(0.2, 0.05, S)
    support.stop_lowering()
    support.follow(10 * S)
    assert (support.force, support.lowering) == (12.0, None)


def pulled(force, seconds, spasm=None):
    """Whether an arm that pulls so long with a force in each direction is noticed."""
    spasm, found = spasm or Spasm(), []
    for n in range(round(seconds * 200) + 1):
        found.append(
            spasm.notices(HandSample(n, n * 5_000_000, *[0.0] * 6, force, 0.6 * force, -force))
        )
    return found[-1]


@pytest.mark.parametrize(("force", "seconds", "noticed"), [
    (40.0, 0.3, True), (-40.0, 0.3, True), (40.0, 0.29, False), (38.0, 2.0, False),
    (math.nan, 2.0, False),
])  # fmt: skip
def test_only_a_hard_and_long_pull_is_a_spasm(force, seconds, noticed):
    assert pulled(force, seconds) is noticed


def test_a_pull_that_ended_is_not_counted_on():
    spasm = Spasm()
    assert not pulled(40.0, 0.2, spasm)
    assert not pulled(0.0, 0.1, spasm)
    assert not pulled(40.0, 0.2, spasm)
