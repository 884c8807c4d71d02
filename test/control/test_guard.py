# SPDX-License-Identifier: Apache-2.0
"""The guard: shaking, and an oscillation that the robot feeds, take the gain away; hands do not."""

import math

import pytest

from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.control import modes
from screw_module_ros.control.guard import (
    FALL,
    LASTING,
    WINDOW,
    Guard,
    forget_chatter,
    forget_outflow,
    guard_step,
    outflow_step,
    tune_guard,
)
from screw_module_ros.control.vertical import VerticalInput, initial_state, vertical_step
from screw_module_ros.control.vertical_settings import VerticalSettings

DT, LIMIT, LEAST = 0.001, 1.2, 1.1
FREQUENCY = 4.0  # [Hz] where hands tremble and a soft wall oscillates
MODEL = thesis_friction()
SETTINGS = VerticalSettings()
REST = VerticalInput(modes.IMPEDANCE, 0.10, 0.0, 0.0, 0.18, 0.0, True)


def quiet():
    """A guard that has seen nothing."""
    guard = Guard()
    tune_guard(guard, DT)
    return guard


# -- chatter -------------------------------------------------------------------------------------


def after(force, seconds, guard=None):
    """Guard after a force, a function of time."""
    guard = guard or quiet()
    for k in range(round(seconds / DT)):
        guard_step(guard, force(k * DT), LIMIT, DT)
    return guard


def sine(amplitude, frequency):
    return lambda t: amplitude * math.sin(2.0 * math.pi * frequency * t)


def nothing(t):
    return 0.0


@pytest.mark.parametrize("frequency", [10.0, 20.0, 60.0, 150.0])
def test_shaking_takes_the_gain_away_within_half_a_second(frequency):
    guard = after(sine(6.0, frequency), LASTING + WINDOW + FALL + 0.1)
    assert guard.share == 0.0
    assert guard.tripped


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
    guard = quiet()
    for k in range(2000):
        guard_step(guard, force(k * DT), LIMIT, DT)
        assert guard.share == 1.0


def test_it_comes_back_below_the_share_at_which_it_shook():
    guard = after(sine(6.0, 60.0), 1.0)
    calm = after(nothing, 5.0, guard).share
    assert 0.3 < calm < 0.6
    after(sine(6.0, 60.0), 1.0, guard)
    assert after(nothing, 5.0, guard).share < calm - 0.1


def test_it_forgets():
    guard = after(sine(6.0, 60.0), 1.0)
    assert after(nothing, 70.0, guard).share == 1.0


def test_it_can_be_made_to_forget_at_once():
    guard = after(sine(6.0, 60.0), 1.0)
    forget_chatter(guard)
    assert guard == quiet()


def test_an_oscillation_that_the_robot_feeds_takes_all_of_the_gain_away():
    """However slow it is, and although it is no longer fed as soon as the gain falls."""
    guard = quiet()
    guard.fed = 1.01 * LASTING
    guard_step(guard, 0.0, LIMIT, DT)
    assert guard.tripped
    guard.fed = 0.0
    least = 1.0
    for _ in range(round(2.0 * FALL / DT)):
        guard_step(guard, 0.0, LIMIT, DT)
        least = min(least, guard.share)
    assert least == 0.0
    assert not guard.tripped
    assert after(nothing, 5.0, guard).share < 0.6


def shaken(inp, seconds=1.0):
    """Share of the force gain after a handle force of 10 N at 20 Hz."""
    state = initial_state(SETTINGS)
    for tick in range(round(seconds / DT)):
        force = 10.0 * math.sin(2.0 * math.pi * 20.0 * tick * DT)
        output = vertical_step(SETTINGS, MODEL, state, inp._replace(force=force), DT)
    return output.share


@pytest.mark.parametrize(
    "inp", [REST._replace(mode=modes.OBSERVER, active=False), REST, REST._replace(mode=modes.OFF)]
)
def test_shaking_that_no_gain_causes_takes_no_gain_away(inp):
    """Mounting a handle without torque left mode 5 with 40 % of its gain for a minute."""
    assert shaken(inp) == 1.0


def test_shaking_in_a_mode_with_a_force_gain_takes_it_away():
    assert shaken(REST._replace(mode=modes.FORCE_FEEDBACK)) == 0.0


# -- outflow -------------------------------------------------------------------------------------


def found_after(force, speed, seconds):
    """Time [s] at which the robot counts as the source, infinite if never."""
    guard = quiet()
    for tick in range(round(seconds / DT)):
        t = tick * DT
        outflow_step(guard, force(t), speed(t), LEAST, DT)
        if guard.fed > LASTING:
            return t
    return math.inf


def wave(size, phase=0.0, growth=0.0, frequency=FREQUENCY):
    omega = 2.0 * math.pi * frequency
    return lambda t: size * math.exp(growth * t) * math.sin(omega * t + phase)


def lagging(loss):
    """Phase of the force behind the velocity: a spring at loss 0, a source below, a sink above."""
    return -0.5 * math.pi + loss


@pytest.mark.parametrize("loss", [-0.2, -0.5, -1.5])
def test_a_robot_that_feeds_an_oscillation_is_found_within_a_second(loss):
    assert found_after(wave(3.0, lagging(loss)), wave(0.1), 3.0) < 1.0


def test_one_that_grows_is_found_soon_after_it_is_large_enough():
    growth = 3.0  # [1/s]
    at = found_after(wave(0.3, lagging(-0.3), growth), wave(0.01, 0.0, growth), 3.0)
    rms = 0.3 * math.exp(growth * at) / math.sqrt(2.0)
    assert LEAST < rms < 4.5


@pytest.mark.parametrize(
    ("force", "speed"),
    [
        (wave(3.0, lagging(0.0)), wave(0.1)),  # a spring
        (wave(3.0, lagging(math.pi)), wave(0.1)),  # a mass
        (wave(3.0, lagging(0.4)), wave(0.1)),  # a hand that trembles and drives the robot
        (wave(1.2, lagging(-0.5)), wave(0.05)),  # too little
        # The robot pushes a hand once.
        (lambda t: -65.0 * min(1.0, t / 0.3), lambda t: 0.05 if t < 0.3 else 0.0),
        (wave(12.0, frequency=0.5), wave(0.3, -lagging(-0.5), frequency=0.5)),  # a hand at work
        (wave(3.0, lagging(-0.2), -6.0), wave(0.1, 0.0, -6.0)),  # a wall rings
    ],
)
def test_what_hands_and_springs_do_does_not_count(force, speed):
    assert found_after(force, speed, 3.0) == math.inf


def test_what_the_robot_fed_is_forgotten_without_a_command():
    guard = quiet()
    for tick in range(2000):
        outflow_step(guard, wave(3.0, lagging(-0.5))(tick * DT), wave(0.1)(tick * DT), LEAST, DT)
    assert guard.fed > LASTING
    forget_outflow(guard)
    assert guard == quiet()
