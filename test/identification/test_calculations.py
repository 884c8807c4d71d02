# SPDX-License-Identifier: Apache-2.0
"""Experiments without a trial (appendices A and D, table 5.1) against what is known otherwise."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import eigh

from screw_module_ros.geometry import forward, inverse, jacobian
from screw_module_ros.identification import back_drive, component_masses
from screw_module_ros.identification import compliant_mounting as mounting
from screw_module_ros.identification.back_drive import (
    ARM,
    LEVEL,
    Belt,
    Wedge,
    bandwidth,
    gain,
    joint_inertia,
    least_anisotropy,
    mode,
    tensor,
)
from screw_module_ros.identification.screw_geometry import (
    INERTIA_ACROSS,
    REFLECTED,
    TABLE,
    Bar,
    candidates,
    cylinder,
)

MOUNTING, DRIVE = mounting.Settings(), back_drive.Settings()
THIN = Bar(0.6, 0.5, 0.0)
BELT = Belt(1e-3, 3e-3, 0.5, 0.02, 0.05)


@pytest.fixture(scope="module")
def driven():
    return back_drive.run(None, DRIVE)


def test_a_thin_bar_on_equal_springs_has_the_textbook_frequencies():
    found = mounting.profile(THIN, np.array([0.0, THIN.half_length]), 2e6, 2e6)[1]
    expected = np.sqrt(np.array([6.0, 3.0]) * 2e6 / THIN.mass) / (2 * math.pi)
    assert found == pytest.approx(expected)


def test_springs_and_lengths_for_a_wanted_frequency_give_it():
    softest = mounting.run(None, MOUNTING).value("case2_softest")
    again = mounting.run(None, MOUNTING._replace(case2_top=softest, case2_bottom=softest))
    assert again.value("case2_frequency_least") == pytest.approx(MOUNTING.wanted)
    half = mounting.half_length_for(MOUNTING)
    thin = Bar(3 * MOUNTING.inertia_across / half**2, 2 * half, 0.0)
    frequencies = mounting.case1(thin, mounting.positions(MOUNTING), MOUNTING)[1]
    assert frequencies.min() == pytest.approx(500.0)


@pytest.mark.parametrize("z", [0.0, 0.1, -0.15])
def test_peaks_are_those_of_two_masses_on_three_springs(z):
    settings = MOUNTING._replace(case3_top=4e6, case3_bottom=1e6, case3_ground=2e6, case3_nut=z)
    up, down = THIN.half_length - z, THIN.half_length + z
    stiffness = [[4e6 * up**2 + 1e6 * down**2, -4e6 * up], [-4e6 * up, 6e6]]
    inertia = np.diag([THIN.mass * (THIN.length**2 / 12 + z**2), settings.top_mass])
    expected = np.sqrt(eigh(stiffness, inertia, eigvals_only=True))
    assert mounting.resonances(mounting.absorber(THIN, settings)) == pytest.approx(expected)


def test_a_rocking_screw_has_its_limit_cases():
    """Case 1 without motor is case 2, symmetric about the centre; there f = l1 sqrt(2 k / I)."""
    z, bare = mounting.positions(MOUNTING), MOUNTING._replace(
        case1_top=2e6, case1_bottom=2e6, top_mass=0.0
    )  # fmt: skip
    found = mounting.case1(THIN, z, bare)[1]
    assert found == pytest.approx(mounting.profile(THIN, z, 2e6, 2e6)[1])
    assert found == pytest.approx(found[::-1])
    inertia = THIN.mass * THIN.length**2 / 12.0
    at_centre = THIN.half_length * math.sqrt(2.0 * 2e6 / inertia) / (2.0 * math.pi)
    assert found[len(z) // 2] == pytest.approx(at_centre)


@pytest.mark.parametrize("z", [0.0, 0.1, -0.15])
def test_an_absorber_dips_at_its_own_frequency_and_on_a_stiff_ground_is_case_2(z):
    settings = MOUNTING._replace(case3_top=4e6, case3_bottom=1e6, case3_ground=2e6, case3_nut=z)
    dip = np.array([math.sqrt((4e6 + 2e6) / settings.top_mass)])
    system = mounting.absorber(THIN, settings)
    assert abs(mounting.response(system, dip)) < 1e-6 * abs(mounting.response(system, 0.9 * dip))
    stiff = mounting.resonances(mounting.absorber(THIN, settings._replace(case3_ground=1e12)))
    alone = mounting.profile(THIN, np.array([z]), 4e6, 1e6)[1]
    assert stiff[0] / (2.0 * math.pi) == pytest.approx(alone[0], rel=1e-4)


def test_the_response_is_that_of_the_state_space():
    system, omega = mounting.absorber(THIN, MOUNTING), np.array([150.0, 1500.0, 4000.0])
    expected = [
        (system.C @ np.linalg.solve(1j * w * np.eye(5) - system.A, system.B))[0, 0] for w in omega
    ]
    assert mounting.response(system, omega) == pytest.approx(np.array(expected))


def test_reflected_masses_fall_with_the_square_of_the_lead():
    lead = component_masses.Settings().lead
    twice = component_masses.run(None, component_masses.Settings(lead=2 * lead))
    assert twice.value("motor_rotor") == pytest.approx(2.132 / 4, abs=0.001)
    parts = sum(twice.value(name) for name in component_masses.PRINTED)
    assert twice.value("sum_computed") == pytest.approx(parts)


def test_a_known_cylinder_is_found_from_its_inertia():
    mass = 7850.0 * math.pi * 0.01**2 * 0.5
    found = cylinder(0.02, mass * (3 * 0.01**2 + 0.5**2) / 12.0, 7850.0)
    assert (found.length, found.mass, found.diameter) == pytest.approx((0.5, mass, 0.02))
    assert found.half_length == pytest.approx(0.25)


def test_every_candidate_has_the_printed_inertia_across_its_axis():
    """The one that reflects the table's mass is thicker than what was measured."""
    screws = candidates()
    for screw in screws.values():
        across = screw.mass * screw.length**2 / 12.0 + screw.inertia_axis / 2.0
        assert across == pytest.approx(INERTIA_ACROSS)
    assert screws[TABLE].reflected() == pytest.approx(REFLECTED)
    assert screws[TABLE].diameter > 0.015875
    grooved, solid = screws["grooved"], screws["outer"]
    assert 0.90 < (grooved.mass / grooved.length) / (solid.mass / solid.length) < 0.96
    assert grooved.length > solid.length


@pytest.mark.parametrize("degrees", [10.0, 23.0, 40.0])
@pytest.mark.parametrize("friction", [0.0, 0.015, 0.15])
def test_a_square_thread_is_a_block_on_a_slope(degrees, friction):
    slope, grip = math.radians(degrees), math.atan(friction)
    expected = math.tan(slope - grip) / math.tan(slope), math.tan(slope) / math.tan(slope + grip)
    assert Wedge(slope, 0.0).efficiencies(friction) == pytest.approx(expected)


@pytest.mark.parametrize("way", [0, 1])
def test_the_limits_are_where_the_efficiencies_vanish(way):
    screw = back_drive.wedge(DRIVE)
    assert screw.efficiencies(0.0) == pytest.approx((1.0, 1.0))
    assert screw.efficiencies(0.999 * screw.limits[way])[way] > 0.0
    assert screw.efficiencies(1.001 * screw.limits[way])[way] == 0.0


def test_a_screw_of_the_least_lead_just_turns_and_one_that_sticks_loses_all(driven):
    # The flank's angle across the thread depends on the lead: keep it, as the thread angle.
    steep = math.atan(driven.value("least_lead_plastic") / (math.pi * DRIVE.diameter))
    screw = Wedge(steep, driven.value("thread_angle"))
    assert screw.limits[0] == pytest.approx(DRIVE.plastic)
    stuck = back_drive.run(None, DRIVE._replace(plastic=0.9))
    assert (stuck.value("back_loss_plastic"), stuck.value("back_gain")) == (1.0, math.inf)


def test_two_free_inertias_twist_at_the_textbook_frequency():
    reduced = BELT.motor * BELT.load / (BELT.motor + BELT.load)
    natural = math.sqrt(BELT.stiffness / reduced)
    expected = natural / (2 * math.pi), BELT.damping / (2 * natural * reduced)
    assert mode(BELT._replace(ground=0.0)) == pytest.approx(expected)


@pytest.mark.parametrize("belt", [BELT, BELT._replace(ground=0.0), Belt(1e-3, 3e-3, 0.5)])
def test_the_gain_is_that_of_the_equations_of_motion_and_ends_at_the_level(belt):
    """Eqs 1 to 3 for a torque of 1 Nm: both speeds and the twist, solved at one frequency."""
    omega = 2.0 * math.pi * bandwidth(belt)
    coupled = belt.damping + belt.stiffness / (1j * omega)
    both = [[1j * omega * belt.motor + belt.ground + coupled, -coupled],
            [-coupled, 1j * omega * belt.load + belt.ground + coupled]]  # fmt: skip
    load = abs(np.linalg.solve(both, [1.0, 0.0])[1])
    assert gain(belt, np.array([omega])) == pytest.approx(load) == pytest.approx(LEVEL)
    assert gain(belt, np.array([1.5 * omega])) < LEVEL


def test_links_at_a_right_angle_feel_like_two_masses():
    found, joints = tensor(*forward(0.0, -math.pi / 2, ARM)), joint_inertia()
    expected = (joints.elbow / ARM.forearm**2, joints.shoulder / ARM.upper_arm**2)
    assert found == pytest.approx(np.diag(expected), abs=1e-9)


def test_kinetic_energy_is_the_same_in_joints_and_at_the_tip():
    shoulder, elbow = inverse(0.11, -0.07, ARM)
    rates = np.array([0.7, -1.3])
    of = joint_inertia()
    across = of.coupling * math.cos(elbow - shoulder)
    joints = rates @ np.array([[of.shoulder, across], [across, of.elbow]]) @ rates
    velocity = np.reshape(jacobian(shoulder, elbow, ARM), (2, 2)) @ rates
    assert velocity @ tensor(0.11, -0.07) @ velocity == pytest.approx(joints)


def test_a_mass_at_the_tip_adds_every_way_and_evens_out(driven):
    data, least = driven.data, driven.value("anisotropy_least")
    assert data["axes_laden"] == pytest.approx(data["axes_bare"] + DRIVE.module_mass)
    assert (data["anisotropy_laden"] < data["anisotropy_bare"]).all()
    assert 0.98 * least < least_anisotropy() <= least * (1.0 + 1e-3), "no place in reach is rounder"
