# SPDX-License-Identifier: Apache-2.0
"""The rotor locked to the transducer: 3600 Hz, solved exactly at any substep."""

from __future__ import annotations

import math

import numpy
import pytest
from scipy.linalg import expm

from screw_module_ros.plant.instruments import rotor_step, rotor_step_settings


def test_undamped_mode_is_3600_hz(settings):
    light = settings.transducer._replace(damping=0.0)
    dt = 1e-6
    p = rotor_step_settings(light, dt)
    angle, velocity, crossings, last = 1e-5, 0.0, 0, 1e-5
    for _ in range(100_000):
        angle, velocity = rotor_step(p, angle, velocity, 0.0)
        crossings += angle * last < 0.0
        last = angle
    assert crossings / 2.0 / 0.1 == pytest.approx(3595.0, abs=5.0)
    assert math.hypot(angle, velocity / 22588.0) == pytest.approx(1e-5, rel=1e-3)


@pytest.mark.parametrize("damping", [0.0, 0.01, 0.2, 0.8854377448, 7.2])
@pytest.mark.parametrize("dt", [5e-6, 50e-6, 500e-6])
def test_step_is_the_matrix_exponential(settings, damping, dt):
    t = settings.transducer._replace(damping=damping)
    p = rotor_step_settings(t, dt)
    inertia = t.rotor_inertia
    matrix = numpy.array([[0.0, 1.0], [-t.stiffness / inertia, -damping / inertia]])
    exact = expm(matrix * dt)
    wide = [[p.angle_angle, p.angle_velocity], [p.velocity_angle, p.velocity_velocity]]
    scale = numpy.array([[1.0, 22588.0], [1.0 / 22588.0, 1.0]])  # to comparable sizes
    assert numpy.allclose(wide * scale, exact * scale, rtol=1e-4, atol=1e-6)


def test_static_torque_is_read_in_full(settings):
    p = rotor_step_settings(settings.transducer, 50e-6)
    angle = velocity = 0.0
    for _ in range(2000):
        angle, velocity = rotor_step(p, angle, velocity, 0.35)
    assert settings.transducer.stiffness * angle == pytest.approx(0.35, rel=1e-9)
