# SPDX-License-Identifier: Apache-2.0
"""States and phases of a session are the constants of its message."""

from screw_module_msgs.msg import SafetyState, TherapyState

from screw_module_ros.therapy.hand import SAFETY_OK
from screw_module_ros.therapy.session import State
from screw_module_ros.therapy.trial import Phase


def test_states_and_phases_are_those_of_the_message():
    for constant in (*State, *Phase):
        assert getattr(TherapyState, constant.name) == constant


def test_the_safety_level_that_permits_is_that_of_the_message():
    assert SafetyState.OK == SAFETY_OK
