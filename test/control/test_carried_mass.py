# SPDX-License-Identifier: Apache-2.0
"""Mass that OBSERVER carries for the hand, against uniform acceleration."""

import pytest

from screw_module_ros.control.carried_mass import CUTOFF, FIRM, KNOWN_SHARE, carried_step
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.filters import lowpass_settled

DT = 1e-3
SETTLED = 2.0 / CUTOFF  # [s] twelve time constants of the filter


def after(acceleration, handle_force, mass=3.5, gain=9.0):
    """Force [N] once the filter has settled on a uniform acceleration [m/s^2]."""
    state, force = lowpass_settled(0.0), 0.0
    for tick in range(round(SETTLED / DT)):
        force, state = carried_step(
            state, acceleration * tick * DT, mass, gain, handle_force, DT
        )
    return force


@pytest.mark.parametrize("acceleration", [-2.0, 0.5])
def test_uniform_acceleration_is_carried_by_the_mass_that_the_gain_leaves(acceleration):
    assert after(acceleration, -5.0) == pytest.approx(0.35 * acceleration, rel=1e-2)


def test_a_handle_that_nobody_holds_is_not_driven():
    assert after(2.0, 0.0) == 0.0


def test_the_force_comes_in_with_the_hand_from_either_side():
    whole = after(2.0, 10.0)
    assert after(2.0, 0.5 * FIRM) == pytest.approx(0.5 * whole)
    assert after(2.0, -0.5 * FIRM) == pytest.approx(0.5 * whole)


def test_even_speed_needs_no_force():
    state = lowpass_settled(0.2)
    force, _ = carried_step(state, 0.2, 3.5, 9.0, 5.0, DT)
    assert force == pytest.approx(0.0, abs=1e-12)


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
