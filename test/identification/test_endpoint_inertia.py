# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest

from screw_module_ros.geometry import MANUS, forward, inverse, jacobian
from screw_module_ros.identification.endpoint_inertia import (
    INMOTION2,
    SETS,
    anisotropy,
    grid,
    least_anisotropy,
    tensor,
    tensors,
)

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


@pytest.mark.parametrize("name", SETS)
def test_sets_are_inertias(name):
    joints, _ = SETS[name]
    assert joints.shoulder * joints.elbow > joints.coupling**2


def test_out_of_reach_is_refused():
    with pytest.raises(ValueError, match="out of reach"):
        tensor(0.0, 0.5, JOINTS)
