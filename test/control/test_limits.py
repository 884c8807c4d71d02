# SPDX-License-Identifier: Apache-2.0
"""Each limit by itself: it holds, it is continuous, and it never pushes outward."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.control.limits import (
    TorqueLimits,
    braking_speed,
    clamp,
    is_real,
    limit_speed,
    limit_torque,
    slew,
    soft_stop,
)

forces = st.floats(-100.0, 100.0)
ZONE = {"low": 0.0, "high": 0.36, "zone": 0.01, "stiffness": 2000.0}
SPEED = {"speed_limit": 0.6, "speed_band": 0.2, "damping": 50.0}
LIMITS = TorqueLimits()
wild_torques = st.one_of(st.floats(-5.0, 5.0), st.sampled_from([math.nan, math.inf, -math.inf]))


@pytest.mark.parametrize(
    ("sample", "real"),
    [((10.0, 100.0, 1e5), True), ((-10.0, -100.0, -1e5), True), ((10.1, 0.0, 0.0), False),
     ((0.0, -101.0, 0.0), False), ((0.0, 0.0, 1.01e5), False), ((0.0, 0.0, math.nan), False)],
)  # fmt: skip
def test_what_no_axis_of_this_robot_can_measure_is_not_real(sample, real):
    assert is_real(*sample) is real


@given(st.floats(), st.floats(-50.0, 0.0), st.floats(0.0, 50.0))
def test_clamp(value, low, high):
    clamped = clamp(value, low, high)
    assert math.isnan(clamped) if math.isnan(value) else clamped == min(high, max(low, value))


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.floats(0.0, 100.0))
def test_slew_moves_at_most_one_step_towards_the_target(previous, target, step):
    moved = slew(previous, target, step)
    assert abs(moved - previous) <= step + 1e-9 * max(1.0, abs(previous))
    assert min(previous, target) <= moved <= max(previous, target)
    assert moved == target or abs(moved - previous) >= step - 1e-9 * max(1.0, abs(previous))


@given(forces, st.floats(0.01, 0.35))
def test_soft_stop_is_absent_inside(force, position):
    assert soft_stop(force, position, **ZONE) == force


@given(forces, st.floats(-0.5, 0.05), st.floats(0.001, 0.05), st.floats(0.0, 1e4))
def test_soft_stop_at_the_bottom_never_adds_a_downward_force(force, position, zone, stiffness):
    out = soft_stop(force, position, 0.0, 0.36, zone, stiffness)
    assert out >= min(force, 0.0)
    if position <= 0.0:
        assert out >= 0.0
    elif position >= zone:
        assert out == force


@given(forces, st.floats(-0.1, 0.46))
def test_soft_stop_treats_both_ends_alike(force, position):
    mirrored = -soft_stop(-force, 0.36 - position, **ZONE)
    assert soft_stop(force, position, **ZONE) == pytest.approx(mirrored, abs=1e-9)


@given(forces, st.floats(-0.6, 0.6))
def test_speed_limit_is_absent_below_it(force, velocity):
    assert limit_speed(force, velocity, **SPEED) == force


@given(forces, st.floats(-5.0, 5.0), st.floats(0.0, 200.0))
def test_speed_limit_never_adds_force_along_the_motion(force, velocity, damping):
    limited = limit_speed(force, velocity, 0.6, 0.2, damping)
    assert limited * velocity <= max(0.0, force * velocity) + 1e-12
    assert abs(limited) <= abs(force) + damping * max(0.0, abs(velocity) - 0.6) + 1e-9
    if abs(velocity) >= 0.8:
        assert limited * velocity <= 1e-9


@given(forces, st.floats(-0.05, 0.41), st.floats(-1.0, 1.0))
def test_soft_stop_and_speed_limit_are_continuous(force, position, velocity):
    step = 1e-7
    there, near = (soft_stop(force, z, **ZONE) for z in (position, position + step))
    assert abs(near - there) <= (100.0 / 0.01 + 2000.0) * step + 1e-9
    there, near = (limit_speed(force, v, **SPEED) for v in (velocity, velocity + step))
    assert abs(near - there) <= (100.0 / 0.2 + 50.0) * step + 1e-9


@given(st.floats(0.5, 100.0), st.floats(0.0, 0.2), st.floats(-0.1, 0.46), st.floats(-2.0, 2.0))
def test_a_hand_of_the_braking_speed_comes_to_rest_at_an_end(braking, reaction, position, velocity):
    """It goes on for the reaction time, then slows down evenly; beyond an end it may not go on."""
    found = braking_speed(braking, reaction, position, velocity, 0.0, 0.36)
    left = 0.36 - position if velocity > 0.0 else position
    assert found >= 0.0
    way = found * reaction + found * found / (2.0 * braking)
    assert way == pytest.approx(max(0.0, left), abs=1e-9)


def held(torque, seconds, heat=0.0):
    """Last torque allowed and the heat after asking for a torque for some time."""
    allowed = 0.0
    for _ in range(round(seconds / 0.001)):
        allowed, heat = limit_torque(LIMITS, heat, torque, 0.001)
    return allowed, heat


def test_peak_is_there_at_first_and_again_after_a_rest_and_between_them_the_continuous_torque():
    assert held(2.0, 0.001)[0] == LIMITS.peak
    allowed, heat = held(2.0, 60.0)
    assert allowed == pytest.approx(LIMITS.continuous, rel=1e-3)
    _, rested = held(0.0, 10.0, heat)
    assert held(2.0, 0.001, rested)[0] == LIMITS.peak


def test_the_continuous_torque_is_never_reduced():
    assert held(0.42, 60.0)[0] == 0.42


@given(
    st.lists(wild_torques, max_size=300),
    st.floats(0.01, 1.0),
    st.floats(0.01, 5.0),
    st.floats(0.5, 10.0),
    st.sampled_from([0.0005, 0.001, 0.002, 0.1, 20.0]),
)
def test_torque_limit_holds_whatever_is_asked(torques, continuous, peak, time_constant, dt):
    limits, heat = TorqueLimits(continuous, peak, time_constant), 0.0
    for torque in torques:
        allowed, heat = limit_torque(limits, heat, torque, dt)
        assert abs(allowed) <= peak
        assert 0.0 <= heat <= continuous * continuous * (1 + 1e-9)
        assert allowed == 0.0 or math.copysign(1.0, allowed) == math.copysign(1.0, torque)
        assert allowed == torque or not abs(torque) <= min(continuous, peak) * (1 - 1e-9)
