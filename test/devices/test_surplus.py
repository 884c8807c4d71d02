# SPDX-License-Identifier: Apache-2.0
"""When answers too many are of a second device, and when of one that was late or fast."""

from __future__ import annotations

import pytest

from screw_module_ros.devices.surplus import MANY, Beats, Surplus

PERIOD_NS = 50_000_000


def test_two_answers_to_each_request_are_known_within_70():
    surplus = Surplus()
    assert next(n for n in range(1, 200) if surplus.note(n, 0)) in range(MANY, 71)


def test_what_was_missed_and_comes_late_is_no_surplus():
    surplus = Surplus()
    assert not any(surplus.note(10, 500) for _ in range(500))


def test_an_old_loss_hides_no_second_device():
    """The count of what was missed, from which the surplus began, was never made good."""
    surplus = Surplus()
    surplus.restart(due=100, missed=3)
    assert not surplus.note(5_000, 800)
    assert any(surplus.note(5_000 + n, 800) for n in range(70))


def test_one_answer_in_five_may_come_twice():
    surplus = Surplus()
    assert not any(surplus.note(5 * n, 0) for n in range(2_000))


def told(gaps) -> bool:
    beats = Beats()
    beats.period_ns = PERIOD_NS
    return any(beats.note(round(gap * PERIOD_NS)) for gap in gaps)


@pytest.mark.parametrize(
    ("gaps", "two"),
    [
        ([1.0] * 500, False), ([0.98, 1.02] * 500, False),
        ([0.3, 0.7] * 100, True), ([0.01, 0.99] * 100, True),
        ([0.02] * 5_000, False),  # its own pace
        ([40.0, *[0.0] * 39] * 20, False),  # they waited unread
    ],
)  # fmt: skip
def test_two_heartbeats_a_period_are_of_two_devices(gaps, two):
    assert told(gaps) == two
