# SPDX-License-Identifier: Apache-2.0
"""Inertia of the planar arm at the handle, against two masses and against kinetic energy."""

from __future__ import annotations

import math

import numpy as np
import pytest

from screw_module_ros.geometry import forward, inverse, jacobian
from screw_module_ros.identification.planar_inertia import ARM, joint_inertia, tensor


def test_a_point_out_of_reach_has_no_inertia():
    with pytest.raises(ValueError, match="out of reach"):
        tensor(0.19, -0.9)


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
