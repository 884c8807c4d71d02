# SPDX-License-Identifier: Apache-2.0
"""The chatter guard: shaking takes the gain away, tremor, jolts and slow forces do not."""

import math

import pytest

from screw_module_ros.control.chatter import FALL, LASTING, QUIET_GUARD, WINDOW, guard_step

DT, LIMIT = 0.001, 1.2


def after(force, seconds, state=QUIET_GUARD, begin=0.0):
    """Guard after a force, a function of time."""
    for k in range(round(seconds / DT)):
        state = guard_step(state, force(begin + k * DT), LIMIT, DT)
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
        state = guard_step(state, force(k * DT), LIMIT, DT)
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
