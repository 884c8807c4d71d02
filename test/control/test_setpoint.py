# SPDX-License-Identifier: Apache-2.0
"""The set point: in its range, no faster than allowed, no push without motion; minimum jerk."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.control import planar, vertical
from screw_module_ros.control.minimum_jerk import PEAK_SPEED, pace, way
from screw_module_ros.control.setpoint import Range, SetPoint, follow, hold_at
from screw_module_ros.geometry import inverse

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


def test_a_jump_arrives_at_the_allowed_speed():
    setpoint = SetPoint(0.1)
    for _ in range(500):
        follow(ALLOWED, setpoint, 0.3, math.nan, DT)
    assert setpoint == SetPoint(0.3)


def test_no_set_point_holds_the_last_one_and_comes_to_rest():
    setpoint = SetPoint(0.1, 0.2, 0.0)
    for _ in range(500):
        follow(ALLOWED, setpoint, math.nan, 0.2, DT)
    assert setpoint == SetPoint(0.1)


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
    stands = [0.1] * 1000
    moves = [0.1 + 0.1 * k * DT for k in range(1500)]
    used = velocities(stands + moves, 0.1, 0.1)
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


FRICTION = thesis_friction()


def test_the_vertical_law_is_not_pushed_for_long_by_a_point_that_stands():
    """The strongest damper, the fastest set point: it was 65 N for ever."""
    settings = vertical.VerticalSettings(damping=500.0, gravity=0.0)
    state, forces = vertical.initial_state(settings), []
    inp = vertical.VerticalInput(1, 0.18, 0.0, 0.0, 0.18, 0.4, True)
    for _ in range(2000):
        output = vertical.vertical_step(settings, FRICTION, state, inp, 0.001)
        forces.append(output.force)
    assert max(forces) > 10.0
    assert max(map(abs, forces[400:])) < 1e-9


def test_nor_is_the_plane():
    settings = planar.PlanarSettings(damping=200.0)
    state, forces = planar.initial_state(settings), []
    inp = planar.PlanarInput(*inverse(0.0, 0.0), 0.0, 0.0, 0.0, 0.0, 0.6, -0.6, True)
    for _ in range(1000):
        output = planar.planar_step(settings, state, inp, 0.002)
        forces.append(math.hypot(output.force_x, output.force_y))
    assert max(forces) > 10.0
    assert max(forces[200:]) < 1e-6


shares = st.floats(-1.0, 2.0)


@given(shares)
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
