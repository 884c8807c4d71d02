# SPDX-License-Identifier: Apache-2.0
"""The transducer: torque of the grip, noise, zeros and their drift."""

from __future__ import annotations

import statistics

import pytest

from screw_module_ros.plant.sensor import measured_wrench, seeded, sensor_params, true_wrench

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
