# SPDX-License-Identifier: Apache-2.0
"""Passivity observer: an oscillation that the robot feeds counts, what hands and springs do not."""

import math

import pytest

from screw_module_ros.control.outflow import NO_OUTFLOW, feeds, outflow_step

DT, LEAST = 0.001, 1.1
FREQUENCY = 4.0  # [Hz] where hands tremble and a soft wall oscillates


def found_after(force, speed, seconds):
    """Time [s] at which the robot counts as the source, infinite if never."""
    state = NO_OUTFLOW
    for tick in range(round(seconds / DT)):
        t = tick * DT
        state = outflow_step(state, force(t), speed(t), LEAST, DT)
        if feeds(state):
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
