# SPDX-License-Identifier: Apache-2.0
"""Damper at standstill: nearly whole for a creep, none in motion, never driving."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.calibration.friction_file import thesis_friction
from screw_module_ros.control import modes
from screw_module_ros.control.hold import FORGET
from screw_module_ros.control.standstill import MOVING, standstill_share, standstill_step
from screw_module_ros.control.vertical import vertical_step
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.control.vertical_state import VerticalInput, initial_state

DAMPING = 40.0
DT = 0.001
LARGEST = 0.25 * DAMPING * MOVING
"""Force that a handle which starts to move meets at most [N]."""

speeds = st.floats(-2.0, 2.0)


def forces(velocity, seconds):
    """Forces [N] and shares over a velocity [m/s] that is a function of time [s]."""
    found, fastest = [], 0.0
    for tick in range(round(seconds / DT)):
        force, fastest = standstill_step(DAMPING, fastest, velocity(tick * DT), DT)
        found.append((force, standstill_share(fastest)))
    return found


def test_a_creep_has_nearly_all_of_the_damper():
    """The hunting that it ends creeps at 0.6 mm/s."""
    force, _ = forces(lambda t: 6e-4, 2.0)[-1]
    assert force == pytest.approx(-0.9 * DAMPING * 6e-4)


@pytest.mark.parametrize(("amplitude", "omega"), [(0.15, 0.8), (0.10, 3.0), (0.03, 1.5)])
def test_motion_is_free_of_it_reversals_included(amplitude, omega):
    """Slow, fast and small motion as in `force_error`."""
    found = forces(lambda t: amplitude * omega * math.cos(omega * t), 4.0 * math.pi / omega)
    assert all(share == 0.0 for _, share in found)


def test_a_start_from_rest_is_hardly_felt():
    found = forces(lambda t: 0.1 * t, 1.0)
    assert max(abs(force) for force, _ in found) <= LARGEST
    assert found[-1] == (0.0, 0.0)


def test_a_handle_that_stops_has_it_back_within_seconds():
    found = forces(lambda t: 0.12 if t < 1.0 else 0.0, 6.0)
    gone = FORGET * math.log(0.12 / MOVING)
    assert found[999 + round(0.9 * gone / DT)][1] == 0.0
    assert found[-1][1] > 0.9


@given(st.lists(speeds, min_size=1, max_size=50), st.floats(0.0, 2.0), st.floats(0.0, 100.0))
def test_it_never_drives_and_stays_small(velocities, fastest, damping):
    for velocity in velocities:
        force, fastest = standstill_step(damping, fastest, velocity, DT)
        assert force * velocity <= 0.0
        assert abs(force) <= damping * min(abs(velocity), 0.25 * MOVING) * (1.0 + 1e-9) + 1e-300
        assert fastest >= abs(velocity)


@given(st.floats(0.0, 2.0), speeds, speeds)
def test_the_force_has_no_jump(fastest, before, after):
    """From one sample to the next it changes with the velocity, and as the speed is forgotten."""
    one, fastest = standstill_step(DAMPING, fastest, before, DT)
    two, _ = standstill_step(DAMPING, fastest, after, DT)
    forgotten = DAMPING * MOVING * DT / FORGET
    assert abs(two - one) <= DAMPING * abs(after - before) + forgotten + 1e-12


def damped(mode, rest_damping, velocity):
    """Force of the dampers [N] on a nut that a hand has moved evenly for 2 s, at a speed [m/s].

    No part of the law takes the hand for friction, which would change the estimated velocity.
    """
    law = VerticalSettings(
        stiffness=0.0, damping=10.0, gravity=0.0, mass=50.0, observer_gain=0.0, observer_limit=0.0,
        rest_damping=rest_damping,
    )  # fmt: skip
    model, state = thesis_friction(), initial_state(law)
    for tick in range(2000):
        inp = VerticalInput(
            mode, 0.15 + velocity * tick * DT, velocity, 0.0, math.nan, math.nan, True
        )
        output, state = vertical_step(law, model, state, inp, DT)
    return output.impedance


@pytest.mark.parametrize("mode", sorted(modes.MODE_NAMES))
def test_only_observer_has_it(mode):
    added = damped(mode, DAMPING, 6e-4) - damped(mode, 0.0, 6e-4)
    expected = -0.9 * DAMPING * 6e-4 if mode == modes.OBSERVER else 0.0
    assert added == pytest.approx(expected, rel=0.02, abs=1e-9)


def test_in_motion_observer_has_its_own_damping_alone():
    one, other = (damped(modes.OBSERVER, damping, 0.03) for damping in (DAMPING, 0.0))
    assert one == pytest.approx(other)
