# SPDX-License-Identifier: Apache-2.0
"""The study behind the contact values of params/plant.yaml: PD, force feedback, chatter.

A sampled loop of its own, written after thesis 3.3, 6.1 and 6.4.3 and not taken from `control`:
spring 100 N/m about 0.18 m, gravity term, back difference and 30 Hz filters, F_c = F_pd +
K_f (F_pd + F_p), the dead zone undone, a given delay from sample to command. The patient is the
thesis's arm with its virtual hand on a sine of 0.15 m at 0.8 rad/s (figs 6-11 to 6-13).
"""

from __future__ import annotations

import math

import numpy
import pytest
from scipy import signal

from screw_module_ros.compiled import compiled
from screw_module_ros.plant.amplifier import bridge_current
from screw_module_ros.plant.module import (
    HUMAN_ARM,
    ModuleInput,
    resting_state,
    vertical_params,
)
from screw_module_ros.plant.patient import arm_force
from screw_module_ros.plant.sensor import normal_pair
from screw_module_ros.plant.vertical import vertical_step

CENTRE, SPRING, GRAVITY = 0.18, 100.0, 10.04
AMPLITUDE, OMEGA = 0.15, 0.8
COUNT = 9.525e-7
SECONDS, SETTLING = 10.0, 2.0
CHATTER = 3.0  # N rms above 15 Hz in a quarter of a second


def command_for(amplifier, current):
    """Invert the amplifier's dead zone by iteration [A]."""
    command = current
    for _ in range(12):
        command -= 0.9 * (bridge_current(amplifier, command) - current)
    return command


def loop(p, amplifier, s, gain, filter_pole, filter_zero, steps, late, noise, record):
    """Run the loop; `steps` substeps per sample, commands act `late` substeps after theirs."""
    dt = p.dt
    period = steps * dt
    last = math.floor(s.nut / COUNT) * COUNT
    raw = velocity = force_in = force = 0.0
    waiting = command = current = 0.0
    first, second = 12345, 54321
    for i in range(record.shape[0]):
        position = math.floor(s.nut / COUNT) * COUNT
        difference = (position - last) / period
        last = position
        velocity = filter_zero * (difference + raw) - filter_pole * velocity
        raw = difference
        noisy, _, first, second = normal_pair(first, second)
        sample = s.patient_force + noise * noisy
        force = filter_zero * (sample + force_in) - filter_pole * force
        force_in = sample
        pd = -SPRING * (position - CENTRE)
        total = pd + GRAVITY + gain * (pd + force)
        waiting = command
        command = command_for(amplifier, total / p.turn_rate / p.torque_constant)
        for k in range(steps):
            if k == late:
                current = bridge_current(amplifier, command)
            elif k == late - steps:
                current = bridge_current(amplifier, waiting)
            time = i * period + k * dt
            hand = CENTRE + AMPLITUDE * math.sin(OMEGA * time)
            speed = AMPLITUDE * OMEGA * math.cos(OMEGA * time)
            u = ModuleInput(current, True, False, HUMAN_ARM, False, 1.0, hand, speed, 0.0, 0.0, 0.0,
                            0.0, 1.0)  # fmt: skip
            s = vertical_step(p, s, u)
        record[i, :] = s.handle, s.handle_velocity, s.patient_force
    return s


@pytest.fixture(scope="module")
def study(settings):
    """`study(gain, rate, delay, **changes of the module)` -> (offset, chatter share, reach)."""
    quick = compiled(loop)
    arm = arm_force(settings.arm)

    def run(gain, rate=1000.0, delay=1.2e-3, **changes):
        module = settings.vertical._replace(**changes)
        p = vertical_params(
            module, settings.friction, settings.amplifier, settings.transducer, arm, 50e-6
        )
        w = math.tan(math.pi * 30.0 / rate)
        record = numpy.zeros((round(SECONDS * rate), 3))
        quick(
            p, settings.amplifier, resting_state(module, CENTRE, 1.0), float(gain),
            (w - 1.0) / (w + 1.0), w / (w + 1.0), round(1.0 / rate / p.dt), round(delay / p.dt),
            settings.sensor.force_noise, record,
        )  # fmt: skip
        return judged(record, rate)

    return run


def judged(record, rate):
    """Return mean |offset| in motion [N], share of time with chatter, reach of the handle [m]."""
    height, velocity, force = record.T
    rapid = signal.sosfiltfilt(signal.butter(4, 15.0, "high", fs=rate, output="sos"), force)
    slow = signal.sosfiltfilt(signal.butter(2, 30.0, fs=rate, output="sos"), force)
    kept = slice(round(SETTLING * rate), None)
    moving = numpy.abs(velocity[kept]) > 5e-3
    offset = numpy.abs(slow - SPRING * (height - CENTRE))[kept][moving]
    window = round(0.25 * rate)
    rapid = rapid[kept]
    rms = numpy.sqrt((rapid[: rapid.size // window * window].reshape(-1, window) ** 2).mean(1))
    return offset.mean(), (rms > CHATTER).mean(), (height[kept].min(), height[kept].max())


LOOPS = [(1000.0, 0.7e-3), (1000.0, 1.2e-3), (2000.0, 0.5e-3)]


def test_pd_leaves_the_friction(study):
    offset, chatter, (low, high) = study(0.0)
    assert 7.0 < offset < 13.0  # thesis fig 6-1: about 10 N
    assert chatter == 0.0
    assert 0.06 < CENTRE - low < 0.14
    assert 0.06 < high - CENTRE < 0.14


@pytest.mark.parametrize(("rate", "delay"), [*LOOPS, (1000.0, 1.6e-3)])
def test_force_feedback_5_takes_most_of_it_away_without_chatter(study, rate, delay):
    offset, chatter, _ = study(5.0, rate, delay)
    assert offset < 3.0  # thesis fig 6-10: about 2 N
    assert chatter == 0.0


@pytest.mark.parametrize(("rate", "delay"), LOOPS)
def test_chatter_sets_in_not_far_above_5(study, rate, delay):
    assert study(9.0, rate, delay)[1] > 0.5


@pytest.mark.parametrize(
    ("support", "loop", "gain", "least", "most"),
    [
        (1e7, LOOPS[1], 11.0, 0.0, 0.0),
        (1e7, LOOPS[1], 30.0, 0.5, 1.0),
        (1e7, LOOPS[2], 7.0, 0.0, 0.0),
        (1e7, LOOPS[2], 16.0, 0.5, 1.0),
        (1e12, LOOPS[2], 16.0, 0.0, 0.0),
    ],
)
def test_without_play_delay_and_support_limit_the_gain(study, support, loop, gain, least, most):
    """At 1 kHz mostly the delay, at 2 kHz the screw's axial support."""
    assert least <= study(gain, *loop, play=0.0, support_stiffness=support)[1] <= most


def test_play_costs_gain(study):
    assert study(11.0)[1] > 0.5
