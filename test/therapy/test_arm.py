# SPDX-License-Identifier: Apache-2.0
"""The arm on the handle: how it is lowered, and when it pulls hard."""

from __future__ import annotations

import math

import pytest

from screw_module_ros.therapy.arm import Arm
from screw_module_ros.therapy.arm_weights import ArmWeight
from screw_module_ros.therapy.hand import HandSample

S = 1_000_000_000


@pytest.fixture
def arm(tmp_path):
    return Arm(tmp_path / "arm_weights.json", lambda: 0)


def test_a_weighing_bounds_what_was_asked_for_before(arm):
    arm.ask(15.0)
    arm.weight = ArmWeight(8.0, 0.0, 0)
    assert arm.force == 10.0
    arm.weight = ArmWeight(20.0, 0.0, 0)
    assert arm.force == 15.0


def test_an_arm_is_lowered_first_and_let_go_then(arm):
    arm.ask(12.0)
    arm.in_use = 12.0
    arm.lower(0.2, 0.05, 10 * S)
    slot, start_ns = arm.lowering.vertical, arm.lowering.start_ns
    assert (slot.start_x, slot.target_x, slot.duration) == (0.2, 0.05, 4.0)
    assert start_ns == 10 * S and arm.lowering.plane is None and slot.validated()
    for second in range(10, 15):
        arm.follow(second * S)
        assert arm.force == 12.0 and arm.lowering, "it hangs on its support on the way"
    arm.follow(15 * S)
    assert arm.force == 0.0
    assert arm.lowering, "the support still goes, and the slot must not let it fall meanwhile"
    arm.in_use = 0.4
    arm.follow(16 * S)
    assert arm.lowering is None


def test_an_arm_below_its_rest_is_not_lifted(arm):
    arm.lower(0.03, 0.05, S)
    assert arm.lowering.vertical.target_x == 0.03


def test_a_support_that_is_asked_for_ends_a_lowering(arm):
    arm.ask(12.0)
    arm.lower(0.2, 0.05, S)
    arm.ask(3.0)
    arm.follow(10 * S)
    assert (arm.force, arm.lowering) == (3.0, None)


def test_a_lowering_that_is_stopped_leaves_the_arm_carried(arm):
    arm.ask(12.0)
    arm.lower(0.2, 0.05, S)
    arm.let_go("it pulls hard")
    arm.follow(10 * S)
    assert (arm.force, arm.lowering) == (12.0, None)


def pulled(arm, force, seconds):
    """Whether an arm that pulls so long with a force in each direction is noticed."""
    found = []
    for n in range(round(seconds * 200) + 1):
        pull = force, 0.6 * force, -force
        found.append(arm.pulls_hard(HandSample(n, n * 5_000_000, *[0.0] * 6, *pull)))
    return found[-1]


@pytest.mark.parametrize(("force", "seconds", "noticed"), [
    (40.0, 0.3, True), (-40.0, 0.3, True), (40.0, 0.29, False), (38.0, 2.0, False),
    (math.nan, 2.0, False),
])  # fmt: skip
def test_only_a_hard_and_long_pull_is_a_spasm(arm, force, seconds, noticed):
    assert pulled(arm, force, seconds) is noticed


def test_a_pull_that_ended_is_not_counted_on(arm):
    assert not pulled(arm, 40.0, 0.2)
    assert not pulled(arm, 0.0, 0.1)
    assert not pulled(arm, 40.0, 0.2)
