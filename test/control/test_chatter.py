# SPDX-License-Identifier: Apache-2.0
"""The chatter guard: shaking takes the gain away, tremor, jolts and slow forces do not."""

import math

import pytest

from screw_module_ros.calibration.friction_file import thesis_friction
from screw_module_ros.control import modes
from screw_module_ros.control.chatter import FALL, LASTING, QUIET_GUARD, WINDOW, guard_step
from screw_module_ros.control.vertical import vertical_step
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.control.vertical_state import VerticalInput, initial_state

DT, LIMIT = 0.001, 1.2
MODEL = thesis_friction()
SETTINGS = VerticalSettings()
REST = VerticalInput(modes.IMPEDANCE, 0.10, 0.0, 0.0, 0.18, 0.0, True)


def after(force, seconds, state=QUIET_GUARD, begin=0.0):
    """Guard after a force, a function of time."""
    for k in range(round(seconds / DT)):
        state = guard_step(state, force(begin + k * DT), False, LIMIT, DT)
    return state


def sine(amplitude, frequency):
    return lambda t: amplitude * math.sin(2.0 * math.pi * frequency * t)


@pytest.mark.parametrize("frequency", [10.0, 20.0, 60.0, 150.0])
def test_shaking_takes_the_gain_away_within_half_a_second(frequency):
    state = after(sine(6.0, frequency), LASTING + WINDOW + FALL + 0.1)
    assert state.share == 0.0
    assert state.tripped


@pytest.mark.parametrize(
    "force",
    [
        sine(40.0, 0.5),  # a hand that works
        sine(3.5, 5.0),  # tremor
        sine(1.0, 60.0),  # noise
        lambda t: 10.0 if 0.3 < t < 0.34 else 0.0,  # a jolt
        lambda t: 12.0 * min(1.0, t / 0.05),  # a hand that grips within 50 ms
    ],
)
def test_what_hands_do_leaves_the_gain(force):
    state = QUIET_GUARD
    for k in range(2000):
        state = guard_step(state, force(k * DT), False, LIMIT, DT)
        assert state.share == 1.0


def test_it_comes_back_below_the_share_at_which_it_shook():
    shaken = after(sine(6.0, 60.0), 1.0)
    calm = after(lambda t: 0.0, 5.0, shaken)
    assert 0.3 < calm.share < 0.6
    again = after(sine(6.0, 60.0), 1.0, calm)
    assert after(lambda t: 0.0, 5.0, again).share < calm.share - 0.1


def test_it_forgets():
    calm = after(lambda t: 0.0, 70.0, after(sine(6.0, 60.0), 1.0))
    assert calm.share == 1.0


def test_an_oscillation_that_the_robot_feeds_takes_all_of_the_gain_away():
    """However slow it is, and although it is no longer fed as soon as the gain falls."""
    state = guard_step(QUIET_GUARD, 0.0, True, LIMIT, DT)
    assert state.tripped
    least = 1.0
    for _ in range(round(2.0 * FALL / DT)):
        state = guard_step(state, 0.0, False, LIMIT, DT)
        least = min(least, state.share)
    assert least == 0.0
    assert not state.tripped
    assert after(lambda t: 0.0, 5.0, state).share < 0.6


def shaken(inp, seconds=1.0):
    """Share of the force gain after a handle force of 10 N at 20 Hz."""
    state = initial_state(SETTINGS)
    for tick in range(round(seconds / DT)):
        force = 10.0 * math.sin(2.0 * math.pi * 20.0 * tick * DT)
        output, state = vertical_step(SETTINGS, MODEL, state, inp._replace(force=force), DT)
    return output.share


@pytest.mark.parametrize(
    "inp", [REST._replace(mode=modes.OBSERVER, active=False), REST, REST._replace(mode=modes.OFF)]
)
def test_shaking_that_no_gain_causes_takes_no_gain_away(inp):
    """Mounting a handle without torque left mode 5 with 40 % of its gain for a minute."""
    assert shaken(inp) == 1.0


def test_shaking_in_a_mode_with_a_force_gain_takes_it_away():
    assert shaken(REST._replace(mode=modes.FORCE_FEEDBACK)) == 0.0
