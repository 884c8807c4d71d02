# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest

from screw_module_ros.geometry import forward, inverse, jacobian
from screw_module_ros.identification import back_drive
from screw_module_ros.identification.back_drive import (
    ARM,
    JOINTS,
    LEVEL,
    Belt,
    Settings,
    Wedge,
    anisotropy,
    bandwidth,
    chosen,
    gain,
    least_anisotropy,
    mode,
    tensor,
    wedge,
)

DEFAULT = Settings()


@pytest.fixture(scope="module")
def result():
    return back_drive.run(None, DEFAULT)


@pytest.mark.parametrize("degrees", [10.0, 23.0, 40.0])
@pytest.mark.parametrize("friction", [0.015, 0.15])
def test_a_square_thread_is_a_block_on_a_slope(degrees, friction):
    slope, grip = math.radians(degrees), math.atan(friction)
    back, forth = Wedge(slope, 0.0).efficiencies(friction)
    assert forth == pytest.approx(math.tan(slope) / math.tan(slope + grip))
    assert back == pytest.approx(math.tan(slope - grip) / math.tan(slope))


def test_nothing_is_lost_without_friction():
    assert wedge(DEFAULT).efficiencies(0.0) == pytest.approx((1.0, 1.0))


@pytest.mark.parametrize("way", [0, 1])
def test_the_limits_are_where_the_efficiencies_vanish(way):
    screw = wedge(DEFAULT)
    assert screw.efficiencies(0.999 * screw.limits[way])[way] > 0.0
    assert screw.efficiencies(1.001 * screw.limits[way])[way] == 0.0


def test_a_screw_of_the_least_lead_just_turns(result):
    lead = result.value("least_lead_plastic")
    # The flank's angle across the thread depends on the lead: keep it, as the thread angle.
    steep = math.atan(lead / (math.pi * DEFAULT.diameter))
    screw = Wedge(steep, result.value("thread_angle"))
    assert screw.limits[0] == pytest.approx(DEFAULT.plastic)


def test_a_screw_that_sticks_loses_everything():
    result = back_drive.run(None, DEFAULT._replace(plastic=0.9))
    assert result.value("back_loss_plastic") == 1.0
    assert math.isinf(result.value("back_gain"))


BELT = Belt(1e-3, 3e-3, 0.5, 0.02, 0.05)


def test_two_free_inertias_twist_at_the_textbook_frequency():
    reduced = BELT.motor * BELT.load / (BELT.motor + BELT.load)
    natural = math.sqrt(BELT.stiffness / reduced)
    frequency, factor = mode(BELT._replace(ground=0.0))
    assert frequency == pytest.approx(natural / (2 * math.pi))
    assert factor == pytest.approx(BELT.damping / (2 * natural * reduced))


@pytest.mark.parametrize("belt", [BELT, BELT._replace(ground=0.0), Belt(1e-3, 3e-3, 0.5)])
def test_the_gain_is_that_of_the_equations_of_motion_and_ends_at_the_level(belt):
    """Eqs 1 to 3 for a torque of 1 Nm: both speeds and the twist, solved at one frequency."""
    end = bandwidth(belt)
    omega = 2.0 * math.pi * end
    coupled = belt.damping + belt.stiffness / (1j * omega)
    both = [[1j * omega * belt.motor + belt.ground + coupled, -coupled],
            [-coupled, 1j * omega * belt.load + belt.ground + coupled]]  # fmt: skip
    load = abs(np.linalg.solve(both, [1.0, 0.0])[1])
    assert gain(belt, np.array([omega])) == pytest.approx(load)
    assert load == pytest.approx(LEVEL)
    assert gain(belt, np.array([1.5 * omega])) < LEVEL


def test_chosen_parameters_give_what_is_printed():
    belt = chosen()
    free = belt._replace(ground=0.0)
    assert mode(free._replace(damping=0.0)) == pytest.approx((3.0, 0.0))
    assert bandwidth(free._replace(damping=0.0)) == pytest.approx(10.6)
    assert mode(free._replace(damping=belt.damping / 10))[1] == pytest.approx(0.446)
    assert bandwidth(belt) == pytest.approx(40.0)


def test_links_at_a_right_angle_feel_like_two_masses():
    found = tensor(*forward(0.0, math.pi / 2, ARM))
    expected = (JOINTS.elbow / ARM.forearm**2, JOINTS.shoulder / ARM.upper_arm**2)
    assert found == pytest.approx(np.diag(expected), abs=1e-9)


def test_kinetic_energy_is_the_same_in_joints_and_at_the_tip():
    x, y = 0.11, -0.07
    shoulder, elbow = inverse(x, y, ARM)
    rates = np.array([0.7, -1.3])
    across = JOINTS.coupling * math.cos(elbow - shoulder)
    joints = rates @ np.array([[JOINTS.shoulder, across], [across, JOINTS.elbow]]) @ rates
    velocity = np.reshape(jacobian(shoulder, elbow, ARM), (2, 2)) @ rates
    assert velocity @ tensor(x, y) @ velocity == pytest.approx(joints)


def test_a_mass_at_the_tip_adds_every_way_and_evens_out(result):
    bare, laden = result.data["axes_bare"], result.data["axes_laden"]
    assert laden == pytest.approx(bare + DEFAULT.module_mass)
    assert (result.data["anisotropy_laden"] < result.data["anisotropy_bare"]).all()


def test_no_place_in_reach_is_rounder_than_the_least(result):
    assert 0.98 * result.value("anisotropy_least") < least_anisotropy()
    assert least_anisotropy() <= result.value("anisotropy_least") * (1.0 + 1e-3)


def test_anisotropy_does_not_depend_on_the_way_the_arm_points():
    near = [forward(turn, turn + 1.2, ARM) for turn in (0.1, 0.9, 2.0)]
    found = anisotropy(np.array([tensor(*point) for point in near]))
    assert np.ptp(found) == pytest.approx(0.0, abs=1e-9)
