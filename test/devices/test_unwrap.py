# SPDX-License-Identifier: Apache-2.0
"""Continuous counts from a wrapping position."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.devices.motion import FULL_RANGE, Unwrapper


@given(st.integers(2, FULL_RANGE), st.lists(st.floats(-0.499, 0.499), max_size=50), st.data())
def test_any_walk_with_steps_below_half_a_range_is_followed(measuring_range, steps, data):
    true = data.draw(st.integers(-(measuring_range // 2), (measuring_range - 1) // 2))
    unwrapper = Unwrapper(measuring_range)
    assert unwrapper.step(true % measuring_range) == true
    for step in steps:
        true += int(step * measuring_range)
        assert unwrapper.step(true % measuring_range) == true


@pytest.mark.parametrize("measuring_range", [0, 1, FULL_RANGE + 1])
def test_ranges_that_cannot_be(measuring_range):
    with pytest.raises(ValueError, match="measuring_range"):
        Unwrapper(measuring_range)
