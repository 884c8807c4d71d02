# SPDX-License-Identifier: Apache-2.0
"""Senders with another rate are named with both rates; late and lost samples are not."""

from __future__ import annotations

import random

import pytest

from screw_module_ros.loop.rate_check import RateCheck
from screw_module_ros.samples import SEQUENCE_MASK

PERIOD_NS = 1_000_000


def heard(rate: float, jitter_ns: int = 0, lost: float = 0.0, count: int = 500, first: int = 0):
    """Return a check after so many ticks of a sender."""
    check, chance = RateCheck("encoder", PERIOD_NS), random.Random(1)
    for tick in range(first, first + count):
        if chance.random() >= lost:
            at_ns = round(tick * 1e9 / rate) + chance.randrange(jitter_ns + 1)
            check.note(tick & SEQUENCE_MASK, at_ns)
    return check


@pytest.mark.parametrize("rate", [200.0, 500.0, 2000.0])
def test_both_rates_are_named(rate):
    assert f"encoder ticks at {rate:.0f} Hz, this node at 1000 Hz" in heard(rate).wrong


@pytest.mark.parametrize("first", [0, SEQUENCE_MASK - 200])
def test_the_same_rate_is_no_fault(first):
    assert heard(1000.0, first=first).wrong == ""


def test_late_and_lost_samples_are_no_other_rate():
    assert heard(1000.0, jitter_ns=3_000_000, lost=0.3).wrong == ""


def test_a_sender_that_comes_back_with_the_right_rate_is_forgiven():
    check = heard(500.0)
    for tick in range(10_000, 10_200):
        check.note(tick, tick * PERIOD_NS)
    assert check.wrong == ""
