# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest

from screw_module_ros.geometry import MANUS, forward, inverse, jacobian
from screw_module_ros.identification import back_drive
from screw_module_ros.identification.back_drive import (
    INMOTION2,
    LEVEL,
    SETS,
    Belt,
    Printed,
    Settings,
    Wedge,
    anisotropy,
    bandwidth,
    chosen,
    grid,
    least_anisotropy,
    mode,
    system,
    tensor,
    tensors,
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
    screw = Wedge(slope, 0.0, friction)
    assert screw.forward_efficiency() == pytest.approx(math.tan(slope) / math.tan(slope + grip))
    assert screw.back_efficiency() == pytest.approx(math.tan(slope - grip) / math.tan(slope))


def test_nothing_is_lost_without_friction():
    screw = wedge(DEFAULT, 0.0)
    assert screw.forward_efficiency() == pytest.approx(1.0)
    assert screw.back_efficiency() == pytest.approx(1.0)


def test_the_limits_are_where_the_efficiencies_vanish():
    screw = wedge(DEFAULT, 0.0)
    for way, limit in (
        ("back_efficiency", screw.back_limit),
        ("forward_efficiency", screw.forward_limit),
    ):
        assert getattr(screw._replace(friction=0.999 * limit), way)() > 0.0
        assert getattr(screw._replace(friction=1.001 * limit), way)() == 0.0


def test_a_screw_of_the_least_lead_just_turns(result):
    lead = result.value("least_lead_plastic")
    # The flank's angle across the thread depends on the lead: keep it, as the thread angle.
    steep = math.atan(lead / (math.pi * DEFAULT.diameter))
    screw = Wedge(steep, result.value("thread_angle"), DEFAULT.plastic)
    assert screw.back_limit == pytest.approx(DEFAULT.plastic)


def test_losses_are_the_papers_when_the_motor_drives(result):
    assert result.value("forward_loss_plastic") == pytest.approx(0.30, abs=0.03)
    assert result.value("forward_loss_roller") < 0.05
    assert result.value("forward_gain") == pytest.approx(0.40, abs=0.02)


def test_a_screw_that_sticks_loses_everything():
    result = back_drive.run(None, DEFAULT._replace(plastic=0.9))
    assert result.value("back_loss_plastic") == 1.0
    assert math.isinf(result.value("back_gain"))


def test_the_later_robots_arm_is_too_heavy_for_the_module():
    result = back_drive.run(None, DEFAULT._replace(plane="inmotion2"))
    assert result.value("anisotropy_greatest_laden") < result.value("anisotropy_greatest")
    assert result.value("anisotropy_least_laden") < result.value("anisotropy_least")
    assert result.value("major_axis_laden") > DEFAULT.heaviest
    assert any("100%" in note for note in result.notes)


BELT = Belt(1e-3, 3e-3, 0.5, 0.02, 0.05)


def gain(belt: Belt, frequency: float) -> float:
    s, space = 2j * math.pi * frequency, system(belt)
    return abs((space.C @ np.linalg.solve(s * np.eye(3) - space.A, space.B))[0, 0])


def test_two_free_inertias_twist_at_the_textbook_frequency():
    reduced = BELT.motor * BELT.load / (BELT.motor + BELT.load)
    natural = math.sqrt(BELT.stiffness / reduced)
    frequency, factor = mode(BELT._replace(ground=0.0))
    assert frequency == pytest.approx(natural / (2 * math.pi))
    assert factor == pytest.approx(BELT.damping / (2 * natural * reduced))


@pytest.mark.parametrize("belt", [BELT, BELT._replace(ground=0.0), Belt(1e-3, 3e-3, 0.5)])
def test_the_bandwidth_ends_at_the_level_of_the_state_space(belt):
    end = bandwidth(belt)
    assert gain(belt, end) == pytest.approx(LEVEL)
    assert gain(belt, 1.5 * end) < LEVEL


def test_chosen_parameters_give_what_is_printed():
    belt = chosen(Printed())
    free = belt._replace(ground=0.0)
    assert mode(free._replace(damping=0.0)) == pytest.approx((3.0, 0.0))
    assert bandwidth(free._replace(damping=0.0)) == pytest.approx(10.6)
    assert mode(free._replace(damping=belt.damping / 10))[1] == pytest.approx(0.446)
    assert bandwidth(belt) == pytest.approx(40.0)


def test_what_was_not_chosen_comes_out_near_the_paper():
    belt = chosen()
    free = belt._replace(ground=0.0)
    assert bandwidth(free) == pytest.approx(51.7, rel=0.06)
    assert mode(free)[1] > 1.0
    assert mode(belt)[1] > 1.0


def test_a_load_that_never_follows_has_no_bandwidth():
    with pytest.raises(ValueError, match="does not fall"):
        bandwidth(BELT._replace(ground=5.0))


JOINTS = INMOTION2


def test_links_at_a_right_angle_feel_like_two_masses():
    found = tensor(*forward(0.0, math.pi / 2), JOINTS)
    expected = (JOINTS.elbow / MANUS.forearm**2, JOINTS.shoulder / MANUS.upper_arm**2)
    assert found == pytest.approx(np.diag(expected), abs=1e-9)


def test_kinetic_energy_is_the_same_in_joints_and_at_the_tip():
    x, y = 0.11, -0.07
    shoulder, elbow = inverse(x, y)
    rates = np.array([0.7, -1.3])
    across = JOINTS.coupling * math.cos(elbow - shoulder)
    joints = rates @ np.array([[JOINTS.shoulder, across], [across, JOINTS.elbow]]) @ rates
    velocity = np.reshape(jacobian(shoulder, elbow), (2, 2)) @ rates
    assert velocity @ tensor(x, y, JOINTS) @ velocity == pytest.approx(joints)


def test_a_mass_at_the_tip_adds_every_way_and_evens_out():
    points = grid(0.1905, 0.2286, 5, 5)
    bare, laden = tensors(points, JOINTS), tensors(points, JOINTS, 2.7)
    assert np.linalg.eigvalsh(laden) == pytest.approx(np.linalg.eigvalsh(bare) + 2.7)
    assert (anisotropy(laden) < anisotropy(bare)).all()


def test_anisotropy_does_not_depend_on_the_way_the_arm_points():
    near = [forward(turn, turn + 1.2) for turn in (0.1, 0.9, 2.0)]
    assert np.ptp(anisotropy(tensors(np.array(near), JOINTS))) == pytest.approx(0.0, abs=1e-9)


def test_the_least_anisotropy_is_below_that_of_the_workspace():
    over = anisotropy(tensors(grid(0.1905, 0.2286, 9, 9), JOINTS))
    assert least_anisotropy(JOINTS) <= over.min() * (1 + 1e-3)


def test_the_derived_set_meets_what_appendix_d_prints():
    joints, arm = SETS["appendix_d"]
    bare = tensors(grid(0.1905, 0.2286, 41, 41), joints, arm=arm)
    over = anisotropy(bare)
    assert over.min() == pytest.approx(1.23, abs=0.02)
    assert over.max() == pytest.approx(1.53, abs=0.02)
    major = np.linalg.eigvalsh(bare)[:, 1]
    assert major.max() <= 4.0 / 3.0
    assert major.max() + 2.7 == pytest.approx(4.0, abs=0.05)
