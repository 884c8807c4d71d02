# SPDX-License-Identifier: Apache-2.0
"""Dampers of the law: at rest in OBSERVER, and where nobody holds a handle without friction.

Each test compares a law that has the damper with one that has not, on the same motion.
"""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.control import modes
from screw_module_ros.control.vertical import (
    HELD,
    MOVING,
    VerticalInput,
    initial_state,
    vertical_step,
)
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.filters import RECENT, envelope

DAMPING, FREE = 40.0, 8.0  # [Ns/m]
DT = 0.001
BEGIN = 1.2  # [s] after which OBSERVER has faded in
LARGEST = 0.25 * DAMPING * MOVING
"""Force that a handle which starts to move meets at most [N]."""
MODEL = thesis_friction()


def impedances(mode, law, velocity, seconds, force=lambda t: 0.0, still=False):
    """Force of the dampers [N] over a velocity [m/s], a function of time [s] after `BEGIN`.

    still: the nut's position shows no motion, so that friction model and observer see none.
    """
    state, position, found = initial_state(law), 0.15, []
    for tick in range(round((BEGIN + seconds) / DT)):
        time = (tick + 0.5) * DT - BEGIN
        speed = velocity(max(time, 0.0))
        position += 0.0 if still else speed * DT
        inp = VerticalInput(
            mode, position, speed, force(max(time, 0.0)), math.nan, math.nan, True
        )
        found.append(vertical_step(law, MODEL, state, inp, DT).impedance)
    return found[round(BEGIN / DT):]


def law_at_rest(rest_damping):
    """No part of this law takes the hand for friction, which would change the estimated speed."""
    return VerticalSettings(
        stiffness=0.0, damping=10.0, gravity=0.0, mass=50.0, observer_gain=0.0, observer_limit=0.0,
        rest_damping=rest_damping,
    )  # fmt: skip


def at_rest(velocity, seconds, mode=modes.OBSERVER):
    """Force [N] of the damper at rest alone."""
    with_it, without = (
        impedances(mode, law_at_rest(damping), velocity, seconds) for damping in (DAMPING, 0.0)
    )
    return [one - other for one, other in zip(with_it, without, strict=True)]


@pytest.mark.parametrize("mode", sorted(modes.MODE_NAMES))
def test_a_creep_has_nearly_all_of_the_damper_in_observer_alone(mode):
    """The hunting that it ends creeps at 0.6 mm/s."""
    expected = -0.9 * DAMPING * 6e-4 if mode == modes.OBSERVER else 0.0
    assert at_rest(lambda t: 6e-4, 1.0, mode)[-1] == pytest.approx(expected, rel=0.02, abs=1e-9)


@pytest.mark.parametrize(("amplitude", "omega"), [(0.15, 0.8), (0.10, 3.0), (0.03, 1.5)])
def test_motion_is_free_of_it_reversals_included(amplitude, omega):
    """Slow, fast and small motion as in `force_error`."""
    found = at_rest(lambda t: amplitude * omega * math.cos(omega * t), 4.0 * math.pi / omega)
    assert max(map(abs, found)) < 1e-9


def test_a_start_from_rest_is_hardly_felt():
    found = at_rest(lambda t: 0.1 * t, 1.0)
    assert 0.5 * LARGEST < max(map(abs, found)) <= LARGEST * (1.0 + 1e-3)
    assert max(found) < 1e-3, "it never drives"
    assert abs(found[-1]) < 1e-9


def test_a_handle_that_stops_has_it_back_within_seconds():
    """It creeps after the stop, so that a damper shows."""
    creep = 6e-4
    found = at_rest(lambda t: 0.05 if t < 1.0 else creep, 6.0)
    gone = RECENT * math.log(0.05 / MOVING)
    assert abs(found[999 + round(0.9 * gone / DT)]) < 1e-9
    assert found[-1] == pytest.approx(-0.9 * DAMPING * creep, rel=0.05)


def test_it_changes_without_a_jump():
    """With the velocity, and as a fast motion is forgotten."""
    found = at_rest(lambda t: 0.02 * math.cos(2.0 * math.pi * min(t, 0.75)) + 1e-3, 6.0)
    steps = [abs(b - a) for a, b in zip(found, found[1:], strict=False)]
    fastest = 2.0 * math.pi * 0.02 * DT  # change of the velocity in a step [m/s]
    assert max(steps) <= DAMPING * (fastest + MOVING * DT / RECENT)


@given(st.lists(st.floats(-2.0, 2.0), min_size=1, max_size=50), st.floats(0.0, 2.0))
def test_the_largest_recent_size_is_never_below_the_present_one(values, largest):
    for value in values:
        before, largest = largest, envelope(largest, value, DT)
        assert abs(value) <= largest <= max(abs(value), before)
    assert envelope(1.0, 0.0, RECENT) == pytest.approx(math.exp(-1.0))


def free_shares(force, seconds):
    """Share of the damper of a free handle, over a force of the hand [N]."""
    law = VerticalSettings(stiffness=0.0, damping=0.0, free_damping=FREE, chatter_limit=50.0)
    speed = 0.1
    found = impedances(
        modes.FRICTION_COMPENSATION, law, lambda t: speed, seconds, force, still=True
    )
    return [-value / (FREE * speed) for value in found]


@pytest.mark.parametrize(("size", "omega"), [(15.0, 0.8), (3.0, 1.5)])
def test_a_hand_that_moves_through_the_middle_of_the_spring_holds_on(size, omega):
    """15 N at 0.8 rad/s, as in slow motion, and 3 N at 1.5 rad/s, as in small motion."""
    found = free_shares(lambda t: size * math.cos(omega * t), 8.0)
    assert max(found) == 0.0


def test_a_released_handle_is_free_soon():
    found = free_shares(lambda t: 5.0 if t < 1.0 else 0.0, 6.0)
    assert max(found[:1000]) == 0.0
    gone = RECENT * math.log(5.0 / HELD)
    assert found[1000 + round(0.9 * gone / DT)] == 0.0
    assert found[1000 + round(1.1 * gone / DT)] > 0.0
    assert found[-1] > 0.9


@pytest.mark.parametrize("mode", [modes.IMPEDANCE, modes.FORCE_FEEDBACK, modes.OBSERVER])
def test_a_free_handle_keeps_its_friction_where_no_model_takes_it(mode):
    law = VerticalSettings(stiffness=0.0, observer_damping_ratio=0.0, rest_damping=0.0)
    one, other = (
        impedances(mode, law._replace(free_damping=damping), lambda t: 0.1, 0.5, still=True)
        for damping in (FREE, 0.0)
    )
    assert one == other
