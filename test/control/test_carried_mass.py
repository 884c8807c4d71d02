# SPDX-License-Identifier: Apache-2.0
"""Mass that OBSERVER carries for the hand, against uniform acceleration."""

import pytest

from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.control import modes
from screw_module_ros.control.vertical import FIRM, VerticalInput, initial_state, vertical_step
from screw_module_ros.control.vertical_settings import KNOWN_SHARE, VerticalSettings

DT = 1e-3
SETTLED = 0.34  # [s] twelve time constants of the filter
MODEL = thesis_friction()
# The hand of this test pushes with the same force whatever the handle does: no observed friction,
# and no guard.
LAW = VerticalSettings(
    stiffness=0.0, fade_time=0.05, observer_limit=0.0, observer_inertia=0.7, mass=5.0,
    observer_gain=9.0, observer_damping_ratio=0.0, observer_bandwidth=1000.0,
    chatter_limit=50.0,
)  # fmt: skip


def after(acceleration, force, law=LAW, speed=0.0):
    """Carried force [N] of a handle at rest that then accelerates evenly [m/s^2]."""
    state = initial_state(law)
    for tick in range(200 + round(SETTLED / DT)):
        time = max(0.0, (tick - 200) * DT)
        position = 0.15 + speed * tick * DT + 0.5 * acceleration * time * time
        velocity = speed + acceleration * time
        inp = VerticalInput(modes.OBSERVER, position, velocity, force, 0.15, 0.0, True)
        output = vertical_step(law, MODEL, state, inp, DT)
    return output.carried


@pytest.mark.parametrize("acceleration", [-1.5, 0.5])
def test_uniform_acceleration_is_carried_by_the_mass_that_the_gain_leaves(acceleration):
    assert after(acceleration, -5.0) == pytest.approx(0.35 * acceleration, rel=2e-2)


def test_a_handle_that_nobody_holds_is_not_driven():
    assert after(1.0, 0.0) == 0.0


def test_the_force_comes_in_with_the_hand_from_either_side():
    whole = after(1.0, 10.0)
    assert after(1.0, 0.5 * FIRM) == pytest.approx(0.5 * whole, rel=1e-3)
    assert after(1.0, -0.5 * FIRM) == pytest.approx(0.5 * whole, rel=1e-3)


def test_even_speed_needs_no_force():
    assert after(0.0, 5.0, speed=0.1) == pytest.approx(0.0, abs=1e-3)


def test_no_share_of_the_mass_no_force():
    assert after(1.0, 5.0, LAW._replace(observer_inertia=0.0)) == 0.0


@pytest.mark.parametrize(("mass", "inertia"), [(9.0, 0.7), (9.0, 0.5), (5.6, 0.7), (50.0, 0.7)])
def test_a_mass_set_by_hand_adds_nothing_to_what_a_measured_one_allows(mass, inertia):
    """9 kg in place of 5.5 carried 6.3 kg / (1 + k) of the 5.5 kg / (1 + k) that are there."""
    law = VerticalSettings().calibrated(10.0, 5.5)._replace(mass=mass, observer_inertia=inertia)
    kept = law.carrying_at_most(5.5)
    carried = kept.mass * kept.observer_inertia
    assert carried == pytest.approx(min(inertia * mass, KNOWN_SHARE * 5.5))
    assert kept._replace(observer_inertia=inertia) == law


def test_a_smaller_mass_or_share_than_the_measured_one_stays():
    law = VerticalSettings().calibrated(10.0, 5.5)
    for own in (law, law._replace(mass=4.0), law._replace(mass=6.0, observer_inertia=0.2)):
        assert own.carrying_at_most(5.5) == own
