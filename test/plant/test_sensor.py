# SPDX-License-Identifier: Apache-2.0
"""The transducer: torques of grip and locked rotor, noise and its generator, drifting zeros."""

from __future__ import annotations

import math
import statistics

import numpy
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from screw_module_ros.compiled import compiled
from screw_module_ros.plant.instruments import rotor_step, rotor_step_settings
from screw_module_ros.plant.sensor import (
    measured_wrench,
    normal_pair,
    seeded,
    sensor_params,
    true_wrench,
    uniform,
)

ZERO = (0.0,) * 6


def samples(p, count, time=0.0):
    first, second = seeded(3)
    wrenches = []
    for _ in range(count):
        wrench, first, second = measured_wrench(p, ZERO, time, first, second)
        wrenches.append(wrench)
    return list(zip(*wrenches, strict=True))


@pytest.mark.parametrize(
    ("given", "wrench"),
    [
        ((10.0, -5.0, 3.0, 0.06, 0.0), (10.0, -5.0, 3.0, 0.3, 0.6, 0.0)),
        ((0.0, 0.0, 0.0, 0.06, 0.35), (0.0, 0.0, 0.0, 0.0, 0.0, 0.35)),
    ],
    ids=["planar force at the grip", "locked rotor"],
)
def test_torques_at_the_transducer(given, wrench):
    assert true_wrench(*given) == pytest.approx(wrench)


def test_noise_is_as_large_as_set_on_each_axis(settings):
    p = sensor_params(settings.sensor, 7)
    for axis, values in enumerate(samples(p, 4000)):
        noise = settings.sensor.force_noise if axis < 3 else settings.sensor.torque_noise
        assert statistics.stdev(values) == pytest.approx(noise, rel=0.05)
        assert statistics.fmean(values) == pytest.approx(p.bias[axis], abs=5.0 * noise / 4000**0.5)


@pytest.mark.parametrize(("time", "share"), [(1e6, 1.0), (900.0, 1.0 - math.exp(-1.0))])
def test_zeros_drift_to_where_the_seed_says(settings, time, share):
    p = sensor_params(settings.sensor, 7)._replace(force_noise=0.0, torque_noise=0.0)
    for axis, (value,) in enumerate(samples(p, 1, time)):
        assert value == pytest.approx(p.bias[axis] + share * p.drift[axis])


def test_seeds_make_different_transducers(settings):
    assert sensor_params(settings.sensor, 1) == sensor_params(settings.sensor, 1)
    assert sensor_params(settings.sensor, 1).bias != sensor_params(settings.sensor, 2).bias
    spread = [b for seed in range(200) for b in sensor_params(settings.sensor, seed).bias[:3]]
    assert statistics.stdev(spread) == pytest.approx(settings.sensor.force_bias, rel=0.1)


def draw(seed, count):
    first, second = seeded(seed)
    numbers = []
    for _ in range(count // 2):
        one, other, first, second = normal_pair(first, second)
        numbers += [one, other]
    return numbers


def test_moments_of_a_normal_distribution():
    numbers = draw(1, 40_000)
    assert statistics.fmean(numbers) == pytest.approx(0.0, abs=0.02)
    assert statistics.stdev(numbers) == pytest.approx(1.0, abs=0.02)
    inside = sum(abs(number) < 1.0 for number in numbers) / len(numbers)
    assert inside == pytest.approx(0.6827, abs=0.01)


def test_neighbours_and_seeds_are_uncorrelated():
    numbers, others = draw(1, 20_000), draw(2, 20_000)
    for shifted in (numbers[1:], numbers[2:], others):
        pairs = list(zip(numbers, shifted, strict=False))
        assert sum(a * b for a, b in pairs) / len(pairs) == pytest.approx(0.0, abs=0.03)


@given(st.integers(0, 2**40))
def test_uniform_stays_between_zero_and_one(seed):
    first, second = seeded(seed)
    for _ in range(20):
        number, first, second = uniform(first, second)
        assert 0.0 < number < 1.0


def test_compiled_noise_is_the_same():
    twin = compiled(normal_pair)
    state = seeded(5)
    for _ in range(100):
        plain, quick = normal_pair(*state), twin(*state)
        assert quick[2:] == plain[2:]
        assert quick[:2] == pytest.approx(plain[:2], rel=1e-12)
        state = plain[2:]


def rotor(transducer, dt, steps, angle=0.0, torque=0.0):
    """Return the angle and the velocity of a locked rotor at the start and after each step."""
    p, states = rotor_step_settings(transducer, dt), [(angle, 0.0)]
    for _ in range(steps):
        states.append(rotor_step(p, *states[-1], torque, 0.0))
    return states


def test_undamped_mode_is_3600_hz(settings):
    states = rotor(settings.transducer._replace(damping=0.0), 1e-6, 100_000, angle=1e-5)
    crossings = sum(a * b < 0.0 for (a, _), (b, _) in zip(states, states[1:], strict=False))
    assert crossings / 2.0 / 0.1 == pytest.approx(3595.0, abs=5.0)
    assert math.hypot(states[-1][0], states[-1][1] / 22588.0) == pytest.approx(1e-5, rel=1e-3)


@pytest.mark.parametrize("damping", [0.0, 0.01, 0.2, 0.8854377448, 7.2])
@pytest.mark.parametrize("dt", [5e-6, 50e-6, 500e-6])
def test_step_is_the_matrix_exponential(settings, damping, dt):
    t = settings.transducer._replace(damping=damping)
    p, inertia = rotor_step_settings(t, dt), t.rotor_inertia
    matrix = numpy.array([[0.0, 1.0], [-t.stiffness / inertia, -damping / inertia]])
    wide = [[p.angle_angle, p.angle_velocity], [p.velocity_angle, p.velocity_velocity]]
    scale = numpy.array([[1.0, 22588.0], [1.0 / 22588.0, 1.0]])  # to comparable sizes
    assert numpy.allclose(wide * scale, expm(matrix * dt) * scale, rtol=1e-4, atol=1e-6)


def test_static_torque_is_read_in_full(settings):
    angle, _ = rotor(settings.transducer, 50e-6, 2000, torque=0.35)[-1]
    assert settings.transducer.stiffness * angle == pytest.approx(0.35, rel=1e-9)
