# SPDX-License-Identifier: Apache-2.0
"""The transducer: torque of the grip, noise and its generator, zeros and their drift."""

from __future__ import annotations

import statistics

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.compiled import compiled
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


def test_planar_force_at_the_grip_gives_torque_at_the_transducer():
    assert true_wrench(10.0, -5.0, 3.0, 0.06, 0.0) == pytest.approx(
        (10.0, -5.0, 3.0, 0.3, 0.6, 0.0)
    )


def test_locked_rotor_is_read_about_z():
    assert true_wrench(0.0, 0.0, 0.0, 0.06, 0.35) == (0.0, 0.0, 0.0, 0.0, 0.0, 0.35)


def test_noise_is_as_large_as_set_on_each_axis(settings):
    p = sensor_params(settings.sensor, 7)
    for axis, values in enumerate(samples(p, 4000)):
        noise = settings.sensor.force_noise if axis < 3 else settings.sensor.torque_noise
        assert statistics.stdev(values) == pytest.approx(noise, rel=0.05)
        assert statistics.fmean(values) == pytest.approx(p.bias[axis], abs=5.0 * noise / 4000**0.5)


def test_zeros_drift_to_where_the_seed_says(settings):
    p = sensor_params(settings.sensor, 7)._replace(force_noise=0.0, torque_noise=0.0)
    for axis, (value,) in enumerate(samples(p, 1, time=1e6)):
        assert value == pytest.approx(p.bias[axis] + p.drift[axis])
    for axis, (value,) in enumerate(samples(p, 1, time=900.0)):
        assert value == pytest.approx(p.bias[axis] + 0.632 * p.drift[axis], abs=1e-3)


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
