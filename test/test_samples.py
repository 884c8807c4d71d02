# SPDX-License-Identifier: Apache-2.0
"""Tick numbers line up across devices and survive their wrap at 2^32."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.samples import SEQUENCE_MASK, sequence_gap


@pytest.mark.parametrize(
    ("previous", "current", "gap"),
    [(4, 5, 0), (4, 7, 2), (4, 4, -1), (4, 3, -2), (SEQUENCE_MASK, 0, 0), (0, SEQUENCE_MASK, -2)],
)
def test_gap_counts_missing_ticks(previous, current, gap):
    assert sequence_gap(previous, current) == gap


@given(st.integers(0, 2**62), st.integers(0, 2**31 - 1))
def test_gap_is_the_ticks_between(tick, missed):
    later = tick + missed + 1
    gap = sequence_gap(tick & SEQUENCE_MASK, later & SEQUENCE_MASK)
    assert gap == missed if missed < 2**31 - 1 else gap in (missed, -(2**31) - 1)
