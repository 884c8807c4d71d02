# SPDX-License-Identifier: Apache-2.0
"""Spring, damper and force feedback against the thesis's equations."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.control.force_feedback import feedback_force
from screw_module_ros.control.impedance import spring_damper

forces = st.floats(-200.0, 200.0)


def test_spring_pulls_towards_the_set_point():
    z, z_desired = 0.10, 0.18
    assert spring_damper(100.0, 0.0, z_desired - z, 0.0) == pytest.approx(8.0)


def test_damper_acts_against_the_velocity():
    assert spring_damper(0.0, 10.0, 0.0, 0.0 - 0.2) == pytest.approx(-2.0)
    assert spring_damper(0.0, -25.0, 0.0, 0.0 - 0.2) == pytest.approx(5.0)


@given(forces)
def test_no_feedback_when_the_patient_balances_the_impedance(force):
    assert feedback_force(5.0, force, -force, 60.0) == 0.0


@given(forces, forces, st.floats(0.0, 50.0))
def test_feedback_never_exceeds_its_limit(desired, measured, gain):
    assert abs(feedback_force(gain, desired, measured, 60.0)) <= 60.0


def test_gain_of_five_leaves_a_sixth_of_the_friction():
    """Equation 6.8: at constant speed friction / (1 + Kf) is left at the handle."""
    friction, gain, desired = 10.0, 5.0, 8.0
    handle = -desired + friction / (1.0 + gain)
    assert handle + desired + feedback_force(gain, desired, handle, 60.0) == pytest.approx(friction)
