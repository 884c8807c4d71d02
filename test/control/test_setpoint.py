# SPDX-License-Identifier: Apache-2.0
"""The set point stays in its range, moves no faster than allowed and is left alone on NaN."""

import math

from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.control.setpoint import Range, SetPoint, follow

ALLOWED = Range(0.0, 0.36, 0.4, 5.0)
DT = 0.001
anything = st.floats(allow_nan=True, allow_infinity=True)


@given(st.lists(st.tuples(anything, anything), max_size=50), st.floats(0.0, 0.36))
def test_in_range_and_rate_limited_whatever_is_asked(wanted, start):
    setpoint = SetPoint(start, 0.0)
    for position, velocity in wanted:
        moved = follow(ALLOWED, setpoint, position, velocity, DT)
        assert 0.0 <= moved.position <= 0.36
        assert abs(moved.velocity) <= 0.4
        assert abs(moved.position - setpoint.position) <= 0.4 * DT + 1e-12
        assert abs(moved.velocity - setpoint.velocity) <= 5.0 * DT + 1e-12
        setpoint = moved


def test_a_jump_arrives_at_the_allowed_speed():
    setpoint = SetPoint(0.1, 0.0)
    for _ in range(500):
        setpoint = follow(ALLOWED, setpoint, 0.3, math.nan, DT)
    assert setpoint == SetPoint(0.3, 0.0)


def test_no_set_point_holds_the_last_one_and_comes_to_rest():
    setpoint = SetPoint(0.1, 0.2)
    for _ in range(500):
        setpoint = follow(ALLOWED, setpoint, math.nan, 0.2, DT)
    assert setpoint == SetPoint(0.1, 0.0)
