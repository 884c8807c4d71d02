# SPDX-License-Identifier: Apache-2.0
"""Screw and planar kinematics against the thesis's figures and against each other."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros import geometry

angles = st.floats(-math.pi, math.pi)


def test_one_count_is_the_thesis_resolution():
    assert geometry.counts_to_height(1) == pytest.approx(9.525e-7, rel=1e-9)


def test_continuous_torque_lifts_138_newton():
    assert geometry.torque_to_force(0.42) == pytest.approx(138.5, abs=0.05)


def test_one_turn_lifts_one_lead():
    assert geometry.counts_to_height(20_000) == pytest.approx(0.01905)


@given(st.floats(-1.0, 1.0))
def test_force_and_torque_undo_each_other(value):
    assert geometry.torque_to_force(geometry.force_to_torque(value)) == pytest.approx(value)


def test_arm_along_the_axes():
    assert geometry.forward(0.0, 0.0) == pytest.approx((0.4064 + 0.51435, -0.65))
    assert geometry.forward(0.0, math.pi / 2) == pytest.approx((0.4064, 0.51435 - 0.65))


@given(st.floats(-0.19, 0.19), st.floats(-0.228, 0.228))
def test_inverse_reaches_the_whole_workspace(x, y):
    shoulder, elbow = geometry.inverse(x, y)
    assert geometry.forward(shoulder, elbow) == pytest.approx((x, y), abs=1e-9)
    assert 0.0 < elbow - shoulder < math.pi


@given(st.floats(-10.0, 10.0), st.floats(-10.0, 10.0))
def test_inverse_out_of_reach_stays_finite(x, y):
    assert all(math.isfinite(angle) for angle in geometry.inverse(x, y))


def test_inverse_out_of_reach_points_at_the_target():
    shoulder, elbow = geometry.inverse(0.0, 5.0)
    assert (shoulder, elbow) == pytest.approx((math.pi / 2, math.pi / 2))


@given(angles, angles)
def test_jacobian_is_the_derivative_of_forward(shoulder, elbow):
    step = 1e-6
    x_s, x_e, y_s, y_e = geometry.jacobian(shoulder, elbow)
    ahead, behind = (
        geometry.forward(shoulder + step, elbow),
        geometry.forward(shoulder - step, elbow),
    )
    assert ((ahead[0] - behind[0]) / (2 * step), (ahead[1] - behind[1]) / (2 * step)) == (
        pytest.approx((x_s, y_s), abs=1e-8)
    )
    ahead, behind = (
        geometry.forward(shoulder, elbow + step),
        geometry.forward(shoulder, elbow - step),
    )
    assert ((ahead[0] - behind[0]) / (2 * step), (ahead[1] - behind[1]) / (2 * step)) == (
        pytest.approx((x_e, y_e), abs=1e-8)
    )
