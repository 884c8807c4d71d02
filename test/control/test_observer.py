# SPDX-License-Identifier: Apache-2.0
"""The disturbance observer finds a force that nobody told it; whether a hand holds the handle."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.control.observer import (
    KEPT,
    Observer,
    command_in_force,
    observe,
    remember,
    settle,
)
from screw_module_ros.control.vertical import HELD, VerticalInput, initial_state, vertical_step
from screw_module_ros.control.vertical_settings import VerticalSettings, least_damping
from screw_module_ros.filters import RECENT, envelope

DT, MASS, BANDWIDTH = 0.001, 5.5, 300.0
LAW = VerticalSettings(mass=MASS, observer_bandwidth=BANDWIDTH, observer_delay=0.0)
LARGE = 10.0  # [N] of force error: not at rest


def watched(disturbance, commands, delay_periods=0, law=LAW):
    """Observer of a mass that a disturbance and delayed commands move, after all commands."""
    position = velocity = 0.0
    state, law = Observer(), law._replace(observer_delay=delay_periods * DT)
    sent = [0.0] * (delay_periods + 1)
    for k, command in enumerate(commands):
        acting = sent[-1 - delay_periods]
        acceleration = (acting - disturbance(k * DT)) / MASS
        position += velocity * DT + 0.5 * acceleration * DT * DT
        velocity += acceleration * DT
        observe(law, state, position, 0.0, LARGE, DT)
        remember(state, command)
        sent.append(command)
    return state, position, velocity


@pytest.mark.parametrize("delay", [0, 1, 3])
@pytest.mark.parametrize("force", [-20.0, 7.0])
def test_constant_disturbance_is_found_whatever_is_commanded(delay, force):
    commands = [10.0 * math.sin(0.1 * k) for k in range(200)]
    state, position, velocity = watched(lambda t: force, commands, delay)
    assert state.disturbance == pytest.approx(force, abs=0.01)
    assert state.velocity == pytest.approx(velocity, abs=1e-4)
    assert state.position == pytest.approx(position, abs=1e-6)


def test_a_step_is_followed_with_the_triple_pole_and_hardly_overshoots():
    found = [
        watched(lambda t: 10.0, [0.0] * n)[0].disturbance for n in range(1, 60)
    ]
    assert max(found) < 10.0 * 1.01
    rise = next(n for n, value in enumerate(found) if value > 6.3) * DT
    assert 2.0 / BANDWIDTH < rise < 5.0 / BANDWIDTH


def test_a_delay_it_does_not_know_of_becomes_disturbance():
    commands = [20.0 * math.sin(0.05 * k) for k in range(400)]
    told, _, _ = watched(lambda t: 0.0, commands, 3)
    assert abs(told.disturbance) < 0.05


def test_disturbance_is_limited_and_comes_back_at_once():
    state, _, _ = watched(lambda t: 100.0 if t < 0.2 else 5.0, [0.0] * 200)
    assert state.disturbance == pytest.approx(35.0)
    state, _, _ = watched(lambda t: 100.0 if t < 0.2 else 5.0, [0.0] * 300)
    assert state.disturbance == pytest.approx(5.0, abs=0.1)


@pytest.mark.parametrize("dt", [5e-324, 1e-300, 1e-12])
def test_two_samples_of_nearly_one_time_change_nothing_much(dt):
    state = Observer(position=0.1)
    observe(LAW._replace(observer_bandwidth=60.0), state, 0.1001, 5.0, LARGE, dt)
    assert state.position == pytest.approx(0.1, abs=1e-9)
    assert abs(state.velocity) < 1e-6 and abs(state.disturbance) < 1e-6


@pytest.mark.parametrize(("error", "found"), [(0.4, 0.0), (-0.4, 0.0), (0.6, 0.35)])
def test_held_by_friction_the_disturbance_stays_while_the_error_is_tolerable(error, found):
    """A command of 0.35 N moves nothing: friction takes it."""
    state = Observer()
    for _ in range(400):
        observe(LAW, state, 0.0, 0.35, error, DT)
    assert state.disturbance == pytest.approx(found, abs=1e-3)


def test_in_motion_a_small_error_does_not_stop_it():
    state, position = Observer(), 0.0
    for _ in range(400):
        position += 0.01 * DT
        observe(LAW, state, position, 5.0, 0.0, DT)
    assert state.disturbance == pytest.approx(5.0, abs=1e-3)


def test_a_nut_put_elsewhere_is_at_rest_there():
    state, _, _ = watched(lambda t: 8.0, [3.0] * 50)
    settle(state, 0.2)
    assert state == Observer(position=0.2, anchor=0.2)


@given(st.floats(0.0, 20.0), st.integers(0, KEPT - 1))
def test_command_in_force_is_the_mean_over_the_period(periods, index):
    commands = [1.0 if n == index else 0.0 for n in range(KEPT)]
    held = min(periods, KEPT - 2.0)
    share = max(0.0, 1.0 - abs(held - index))
    assert command_in_force(commands, periods) == pytest.approx(share)


def test_least_damping_makes_the_model_of_a_released_handle_damped_enough():
    """The apparent mass with the gain's filter in the spring's way, its poles by hand."""
    numpy = pytest.importorskip("numpy")
    for stiffness in (50.0, 100.0, 400.0):
        gain, cutoff, ratio = 10.0, 2.0 * math.pi * 10.0, 0.25
        law = LAW._replace(
            observer_gain=gain,
            observer_cutoff=cutoff / (2.0 * math.pi),
            observer_damping_ratio=ratio,
            observer_delay=0.0,
        )
        damping = least_damping(law, stiffness)
        # M s^2 (1 + s/c) + (1 + k + s/c) (K + B s) = 0
        poles = numpy.roots(
            [
                MASS / cutoff,
                MASS + damping / cutoff,
                stiffness / cutoff + (1.0 + gain) * damping,
                (1.0 + gain) * stiffness,
            ]
        )
        worst = min(-p.real / abs(p) for p in poles)
        assert worst > 0.7 * ratio
        undamped = numpy.roots([MASS / cutoff, MASS, stiffness / cutoff, (1.0 + gain) * stiffness])
        assert min(-p.real for p in undamped) < 0.0, "without a damper it swings up"


def test_no_ratio_asks_for_no_damping():
    assert least_damping(LAW._replace(observer_damping_ratio=0.0), 1000.0) == 0.0


MODEL = thesis_friction()


@given(st.lists(st.floats(-2.0, 2.0), min_size=1, max_size=50), st.floats(0.0, 2.0))
def test_the_largest_recent_size_is_never_below_the_present_one(values, largest):
    for value in values:
        before, largest = largest, envelope(largest, value, DT)
        assert abs(value) <= largest <= max(abs(value), before)
    assert envelope(1.0, 0.0, RECENT) == pytest.approx(math.exp(-1.0))


@pytest.mark.parametrize(("size", "omega"), [(15.0, 0.8), (3.0, 1.5)])
def test_a_hand_that_moves_through_the_middle_of_the_spring_holds_on(size, omega):
    """15 N at 0.8 rad/s, as in slow motion, and 3 N at 1.5 rad/s, as in small motion."""
    held = size
    for tick in range(8000):
        held = envelope(held, size * math.cos(omega * tick * DT), DT)
        assert held > HELD


def friction_after(seconds, released):
    """Friction fed forward [N] to a nut at 0.1 m/s with 5 N of the hand up to a time [s]."""
    law, position = VerticalSettings(stiffness=0.0, damping=0.0), 0.02
    state = initial_state(law)
    for tick in range(round(seconds / DT)):
        position = 0.02 + (position - 0.02 + 0.1 * DT) % 0.3
        hand = 5.0 if tick * DT < released else 0.0
        inp = VerticalInput(2, position, 0.1, hand, math.nan, math.nan, True)
        output = vertical_step(law, MODEL, state, inp, DT)
    return output.friction


def test_a_released_handle_has_its_friction_back_within_seconds():
    """The model would leave it none to come to rest on its spring."""
    whole = friction_after(6.0, 6.0)
    gone = RECENT * math.log(5.0 / HELD)  # until the hand counts as let go
    assert whole > 3.0
    assert friction_after(6.0, 6.0 - 0.9 * gone) > 0.5 * whole
    assert abs(friction_after(6.0, 1.0)) < 0.1 * whole
