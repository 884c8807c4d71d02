# SPDX-License-Identifier: Apache-2.0
"""Whether a hand holds the handle: the friction model is fed forward only for one that does."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.control.vertical import HELD, VerticalInput, initial_state, vertical_step
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.filters import RECENT, envelope

DT = 0.001
MODEL = thesis_friction()


@given(st.lists(st.floats(-2.0, 2.0), min_size=1, max_size=50), st.floats(0.0, 2.0))
def test_the_largest_recent_size_is_never_below_the_present_one(values, largest):
    for value in values:
        before, largest = largest, envelope(largest, value, DT)
        assert abs(value) <= largest <= max(abs(value), before)
    assert envelope(1.0, 0.0, RECENT) == pytest.approx(math.exp(-1.0))


@pytest.mark.parametrize(("size", "omega"), [(15.0, 0.8), (3.0, 1.5)])
def test_a_hand_that_moves_through_the_middle_of_the_spring_holds_on(size, omega):
    """15 N at 0.8 rad/s, as in slow motion, and 3 N at 1.5 rad/s, as in small motion."""
    held = size
    for tick in range(8000):
        held = envelope(held, size * math.cos(omega * tick * DT), DT)
        assert held > HELD


def friction_after(seconds, released):
    """Friction fed forward [N] to a nut at 0.1 m/s with 5 N of the hand up to a time [s]."""
    law, position = VerticalSettings(stiffness=0.0, damping=0.0), 0.02
    state = initial_state(law)
    for tick in range(round(seconds / DT)):
        position = 0.02 + (position - 0.02 + 0.1 * DT) % 0.3
        hand = 5.0 if tick * DT < released else 0.0
        inp = VerticalInput(2, position, 0.1, hand, math.nan, math.nan, True)
        output = vertical_step(law, MODEL, state, inp, DT)
    return output.friction


def test_a_released_handle_has_its_friction_back_within_seconds():
    """The model would leave it none to come to rest on its spring."""
    whole = friction_after(6.0, 6.0)
    gone = RECENT * math.log(5.0 / HELD)  # until the hand counts as let go
    assert whole > 3.0
    assert friction_after(6.0, 6.0 - 0.9 * gone) > 0.5 * whole
    assert abs(friction_after(6.0, 1.0)) < 0.1 * whole
