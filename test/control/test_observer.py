# SPDX-License-Identifier: Apache-2.0
"""The disturbance observer finds a force that nobody told it; the mass that OBSERVER carries."""

import math

import numpy
import pytest
from hypothesis import given
from hypothesis import strategies as st
from law_runs import DT, vertical_outputs

from screw_module_ros.control import modes
from screw_module_ros.control.laws.thesis import FIRM, HELD
from screw_module_ros.control.observer import (
    KEPT,
    Observer,
    command_in_force,
    observe,
    remember,
    settle,
)
from screw_module_ros.control.vertical import VerticalInput
from screw_module_ros.control.vertical_settings import (
    KNOWN_SHARE,
    VerticalSettings,
    least_damping,
)
from screw_module_ros.filters import RECENT, envelope

MASS, BANDWIDTH = 5.5, 300.0
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
@pytest.mark.parametrize("force", [-20.0, 0.0, 7.0])
def test_constant_disturbance_is_found_whatever_is_commanded(delay, force):
    """And a delay that it is told of is no disturbance."""
    commands = [10.0 * math.sin(0.1 * k) for k in range(200)]
    state, position, velocity = watched(lambda t: force, commands, delay)
    assert state.disturbance == pytest.approx(force, abs=0.01)
    assert state.velocity == pytest.approx(velocity, abs=1e-4)
    assert state.position == pytest.approx(position, abs=1e-6)


def test_a_step_is_followed_with_the_triple_pole_and_hardly_overshoots():
    found = [watched(lambda t: 10.0, [0.0] * n)[0].disturbance for n in range(1, 60)]
    assert max(found) < 10.0 * 1.01
    rise = next(n for n, value in enumerate(found) if value > 6.3) * DT
    assert 2.0 / BANDWIDTH < rise < 5.0 / BANDWIDTH


@pytest.mark.parametrize(("ticks", "found"), [(200, 35.0), (300, 5.0)])
def test_disturbance_is_limited_and_comes_back_at_once(ticks, found):
    state, _, _ = watched(lambda t: 100.0 if t < 0.2 else 5.0, [0.0] * ticks)
    assert state.disturbance == pytest.approx(found, abs=0.1)
    assert state.disturbance <= 35.0


@pytest.mark.parametrize("dt", [5e-324, 1e-300, 1e-12])
def test_two_samples_of_nearly_one_time_change_nothing_much(dt):
    state = Observer(position=0.1)
    observe(LAW._replace(observer_bandwidth=60.0), state, 0.1001, 5.0, LARGE, dt)
    assert state.position == pytest.approx(0.1, abs=1e-9)
    assert abs(state.velocity) < 1e-6 and abs(state.disturbance) < 1e-6


@pytest.mark.parametrize(
    ("error", "speed", "command", "found"),
    [
        (0.4, 0.0, 0.35, 0.0),  # moves nothing: friction takes it, while the error is tolerable
        (-0.4, 0.0, 0.35, 0.0),
        (0.6, 0.0, 0.35, 0.35),
        (0.0, 0.01, 5.0, 5.0),  # in motion a small error does not stop it
    ],
)
def test_held_by_friction_the_disturbance_stays(error, speed, command, found):
    state = Observer()
    for tick in range(1, 401):
        observe(LAW, state, speed * tick * DT, command, error, DT)
    assert state.disturbance == pytest.approx(found, abs=1e-3)


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


@pytest.mark.parametrize("stiffness", [50.0, 100.0, 400.0])
def test_least_damping_makes_the_model_of_a_released_handle_damped_enough(stiffness):
    """The apparent mass with the gain's filter in the spring's way, its poles by hand."""
    gain, cutoff, ratio = 10.0, 2.0 * math.pi * 10.0, 0.25
    law = LAW._replace(
        observer_gain=gain, observer_cutoff=cutoff / (2.0 * math.pi), observer_damping_ratio=ratio
    )

    def poles(damping):
        # M s^2 (1 + s/c) + (1 + k + s/c) (K + B s) = 0
        return numpy.roots(
            [
                MASS / cutoff,
                MASS + damping / cutoff,
                stiffness / cutoff + (1.0 + gain) * damping,
                (1.0 + gain) * stiffness,
            ]
        )

    assert min(-p.real / abs(p) for p in poles(least_damping(law, stiffness))) > 0.7 * ratio
    assert min(-p.real for p in poles(0.0)) < 0.0, "without a damper it swings up"
    assert least_damping(law._replace(observer_damping_ratio=0.0), stiffness) == 0.0


# -- whether a hand holds the handle ---------------------------------------------------------------


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
    inputs = [
        VerticalInput(
            modes.FRICTION_COMPENSATION, 0.02 + 0.1 * (tick * DT % 3.0), 0.1,
            5.0 if tick * DT < released else 0.0, math.nan, math.nan, True,
        )
        for tick in range(round(seconds / DT))
    ]  # fmt: skip
    return vertical_outputs(inputs, VerticalSettings(stiffness=0.0, damping=0.0))[-1].friction


def test_a_released_handle_has_its_friction_back_within_seconds():
    """The model would leave it none to come to rest on its spring."""
    whole = friction_after(6.0, 6.0)
    gone = RECENT * math.log(5.0 / HELD)  # until the hand counts as let go
    assert whole > 3.0
    assert friction_after(6.0, 6.0 - 0.9 * gone) > 0.5 * whole
    assert abs(friction_after(6.0, 1.0)) < 0.1 * whole


# -- the mass that is carried for the hand ---------------------------------------------------------

# The hand of this test pushes with the same force whatever the handle does: no observed friction,
# and no guard.
CARRYING = VerticalSettings(
    stiffness=0.0, fade_time=0.05, observer_limit=0.0, observer_inertia=0.7, mass=5.0,
    observer_gain=9.0, observer_damping_ratio=0.0, observer_bandwidth=1000.0,
    chatter_limit=50.0,
)  # fmt: skip


def carried(acceleration, force, law=CARRYING, speed=0.0):
    """Carried force [N] of a handle at even speed for 0.2 s that then accelerates for 0.34 s, at
    heights where the ends of travel limit no speed.

    These are twelve time constants of the filter.
    """
    inputs = []
    for tick in range(540):
        time = max(0.0, (tick - 200) * DT)
        position = 0.20 + speed * tick * DT + 0.5 * acceleration * time * time
        velocity = speed + acceleration * time
        inputs.append(VerticalInput(modes.OBSERVER, position, velocity, force, 0.20, 0.0, True))
    return vertical_outputs(inputs, law)[-1].carried


@pytest.mark.parametrize("acceleration", [-1.5, 0.5])
def test_uniform_acceleration_is_carried_by_the_mass_that_the_gain_leaves(acceleration):
    assert carried(acceleration, -5.0) == pytest.approx(0.35 * acceleration, rel=2e-2)


def test_the_force_comes_in_with_the_hand_from_either_side():
    whole = carried(1.0, 10.0)
    assert carried(1.0, 0.0) == 0.0, "nobody holds it"
    assert carried(1.0, 0.5 * FIRM) == pytest.approx(0.5 * whole, rel=1e-3)
    assert carried(1.0, -0.5 * FIRM) == pytest.approx(0.5 * whole, rel=1e-3)


def test_even_speed_needs_no_force_nor_does_no_share_of_the_mass():
    assert carried(0.0, 5.0, speed=0.1) == pytest.approx(0.0, abs=1e-3)
    assert carried(1.0, 5.0, CARRYING._replace(observer_inertia=0.0)) == 0.0


@pytest.mark.parametrize(("mass", "inertia"), [(9.0, 0.7), (9.0, 0.5), (5.6, 0.7), (50.0, 0.7)])
def test_a_mass_set_by_hand_adds_nothing_to_what_a_measured_one_allows(mass, inertia):
    """9 kg in place of 5.5 carried 6.3 kg / (1 + k) of the 5.5 kg / (1 + k) that are there."""
    law = VerticalSettings().calibrated(10.0, 5.5)._replace(mass=mass, observer_inertia=inertia)
    kept = law.carrying_at_most(5.5)
    carried_kg = kept.mass * kept.observer_inertia
    assert carried_kg == pytest.approx(min(inertia * mass, KNOWN_SHARE * 5.5))
    assert kept._replace(observer_inertia=inertia) == law


@pytest.mark.parametrize("own", [{}, {"mass": 4.0}, {"mass": 6.0, "observer_inertia": 0.2}])
def test_a_smaller_mass_or_share_than_the_measured_one_stays(own):
    law = VerticalSettings().calibrated(10.0, 5.5)._replace(**own)
    assert law.carrying_at_most(5.5) == law
