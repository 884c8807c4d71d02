# SPDX-License-Identifier: Apache-2.0
"""Tick numbers line up across devices and survive their wrap at 2^32."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from screw_module_ros.samples import SEQUENCE_MASK, sequence_gap, tick_number

PERIOD_NS = 1_000_000


def test_instants_of_one_tick_share_its_number():
    start = 7 * PERIOD_NS
    assert tick_number(start, PERIOD_NS) == tick_number(start + PERIOD_NS - 1, PERIOD_NS) == 7
    assert tick_number(start + PERIOD_NS, PERIOD_NS) == 8


@pytest.mark.parametrize(
    ("previous", "current", "gap"),
    [(4, 5, 0), (4, 7, 2), (4, 4, -1), (4, 3, -2), (SEQUENCE_MASK, 0, 0), (0, SEQUENCE_MASK, -2)],
)
def test_gap_counts_missing_ticks(previous, current, gap):
    assert sequence_gap(previous, current) == gap


@settings(deadline=None)
@given(st.integers(0, 2**62), st.integers(1, 10**7), st.integers(0, 2**31 - 1))
def test_gap_of_two_instants_is_the_ticks_between(now_ns, period_ns, missed):
    later_ns = now_ns + (missed + 1) * period_ns
    gap = sequence_gap(tick_number(now_ns, period_ns), tick_number(later_ns, period_ns))
    assert gap == missed if missed < 2**31 - 1 else gap in (missed, -(2**31) - 1)
