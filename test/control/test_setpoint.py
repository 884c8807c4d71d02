# SPDX-License-Identifier: Apache-2.0
"""The set point: in its range, no faster than allowed, no push without motion; minimum jerk."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from law_runs import PLANAR, VERTICAL, planar_outputs, plane_at, vertical_outputs

from screw_module_ros.control import vertical
from screw_module_ros.control.minimum_jerk import PEAK_SPEED, pace, way
from screw_module_ros.control.setpoint import Range, SetPoint, follow, hold_at

ALLOWED = Range(0.0, 0.36, 0.4, 5.0)
DT = 0.001
anything = st.floats(allow_nan=True, allow_infinity=True)


@given(st.lists(st.tuples(anything, anything), max_size=50), st.floats(0.0, 0.36))
def test_in_range_and_rate_limited_whatever_is_asked(wanted, start):
    setpoint = SetPoint(start)
    for position, velocity in wanted:
        before = replace(setpoint)
        follow(ALLOWED, setpoint, position, velocity, DT)
        assert 0.0 <= setpoint.position <= 0.36
        assert abs(setpoint.velocity) <= 0.4
        assert abs(setpoint.position - before.position) <= 0.4 * DT + 1e-12
        assert abs(setpoint.velocity - before.velocity) <= 5.0 * DT + 1e-12


@pytest.mark.parametrize(
    ("begin", "asked", "promised", "end"),
    [
        (SetPoint(0.1), 0.3, math.nan, 0.3),  # a jump arrives at the allowed speed
        (SetPoint(0.1, 0.2, 0.0), math.nan, 0.2, 0.1),  # without one the last one is held
    ],
)
def test_where_it_comes_to_rest(begin, asked, promised, end):
    setpoint = replace(begin)
    for _ in range(500):
        follow(ALLOWED, setpoint, asked, promised, DT)
    assert setpoint == SetPoint(end)


def test_it_can_be_brought_to_rest_elsewhere():
    setpoint = SetPoint(0.1, 0.2, 0.01)
    hold_at(setpoint, 0.3)
    assert setpoint == SetPoint(0.3)


# -- a velocity is believed as far as the set point moves ----------------------------------------


def velocities(positions, velocity, start):
    """The velocity in use while a game asks for these positions, one a tick."""
    setpoint, used = SetPoint(start), []
    for position in positions:
        told = velocity(len(used) * DT) if callable(velocity) else velocity
        follow(ALLOWED, setpoint, position, told, DT)
        used.append(setpoint.velocity)
    return used


@pytest.mark.parametrize("velocity", [0.4, -0.4, 0.1, 1e300, 1e-9])
@pytest.mark.parametrize("place", [0.2, 0.36, 1.0])
def test_a_set_point_that_stands_still_pushes_for_a_moment_only(velocity, place):
    """At rest, at the end of its range, and beyond it."""
    used = velocities([place] * 3000, velocity, min(place, 0.36))
    assert any(used), "a moment it is believed"
    assert not any(used[300:])
    assert abs(sum(used)) * DT <= 0.2 * min(abs(velocity), 0.4) + 1e-12


@pytest.mark.parametrize("rate", [10, 20, 60, 1000])
def test_a_set_point_that_moves_as_it_says_is_believed(rate):
    """Sent at any rate from 10 Hz on, in steps: all of the velocity acts, all of the time."""
    every = 1000 // rate
    positions = [0.05 + 0.1 * (k // every * every) * DT for k in range(2500)]
    used = velocities(positions, 0.1, 0.05)
    assert min(used[100:]) == pytest.approx(0.1)


def test_a_sine_is_believed_through_its_turns():
    """0.1 m at 3 rad/s, 60 times a second."""
    at = [k // 16 * 16 * DT for k in range(6000)]
    positions = [0.18 + 0.1 * math.sin(3.0 * time) for time in at]
    used = velocities(positions, lambda time: 0.3 * math.cos(3.0 * time), 0.18)
    worst = max(abs(v - 0.3 * math.cos(3.0 * k * DT)) for k, v in enumerate(used) if k > 200)
    assert worst < 0.01


def test_a_set_point_that_moves_again_is_believed_again():
    moves = [0.1 + 0.1 * k * DT for k in range(1500)]
    used = velocities([0.1] * 1000 + moves, 0.1, 0.1)
    assert used[999] == 0.0
    assert min(used[1000 + 500 :]) == pytest.approx(0.1)


def test_one_that_creeps_is_believed_as_far_as_it_creeps():
    """It says 0.4 m/s and makes 0.02: the hand is not pushed with 0.4 for long."""
    used = velocities([0.1 + 0.02 * k * DT for k in range(5000)], 0.4, 0.1)
    assert max(used[400:]) < 0.1


@given(st.lists(st.tuples(st.floats(0.0, 0.36), anything), max_size=300))
def test_no_velocity_is_larger_than_the_game_s(wanted):
    setpoint = SetPoint(0.1)
    for position, velocity in wanted:
        follow(ALLOWED, setpoint, position, velocity, 0.02)
        assert math.isfinite(setpoint.velocity) and math.isfinite(setpoint.owed)
        assert abs(setpoint.owed) <= 0.4 * 0.2 + 1e-12


def test_the_laws_are_not_pushed_for_long_by_a_point_that_stands():
    """The strongest damper, the fastest set point: it was 65 N for ever."""
    inp = vertical.VerticalInput(1, 0.18, 0.0, 0.0, 0.18, 0.4, True)
    stiff = VERTICAL._replace(damping=500.0, gravity=0.0)
    up = [abs(output.force) for output in vertical_outputs([inp] * 2000, stiff)]
    aside = plane_at(0.0, 0.0, (0.0, 0.0, 0.6, -0.6))
    outputs = planar_outputs([aside] * 1000, PLANAR._replace(damping=200.0))
    for forces in (up, [math.hypot(output.force_x, output.force_y) for output in outputs]):
        assert max(forces) > 10.0
        assert max(forces[len(forces) // 5 :]) < 1e-6


@given(st.floats(-1.0, 2.0))
def test_it_stays_on_the_way_and_pace_is_its_slope(share):
    step = 1e-5
    assert 0.0 <= way(share) <= 1.0 + 1e-12
    slope = (way(share + step) - way(share - step)) / (2.0 * step)
    assert pace(share) == pytest.approx(slope, abs=1e-3)


@given(st.floats(0.0, 1.0))
def test_the_way_is_symmetric(share):
    assert way(share) + way(1.0 - share) == pytest.approx(1.0, abs=1e-12)
    assert pace(share) <= PEAK_SPEED + 1e-12


def test_the_way_is_the_closed_form():
    assert (way(0.0), way(0.5), way(1.0)) == pytest.approx((0.0, 0.5, 1.0))
    assert way(0.25) == pytest.approx(10 / 64 - 15 / 256 + 6 / 1024)
    assert (pace(0.0), pace(0.5), pace(1.0)) == pytest.approx((0.0, PEAK_SPEED, 0.0))
