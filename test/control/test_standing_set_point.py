# SPDX-License-Identifier: Apache-2.0
"""A set point that stands still and carries a velocity does not push the hand for long."""

from __future__ import annotations

import math

from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.control import planar, vertical
from screw_module_ros.geometry import inverse

FRICTION = thesis_friction()


def test_vertical():
    """The strongest damper, the fastest set point: it was 65 N for ever."""
    settings = vertical.VerticalSettings(damping=500.0, gravity=0.0)
    state, forces = vertical.initial_state(settings), []
    inp = vertical.VerticalInput(1, 0.18, 0.0, 0.0, 0.18, 0.4, True)
    for _ in range(2000):
        output = vertical.vertical_step(settings, FRICTION, state, inp, 0.001)
        forces.append(output.force)
    assert max(forces) > 10.0
    assert max(map(abs, forces[400:])) < 1e-9


def test_plane():
    settings = planar.PlanarSettings(damping=200.0)
    state, forces = planar.initial_state(settings), []
    inp = planar.PlanarInput(*inverse(0.0, 0.0), 0.0, 0.0, 0.0, 0.0, 0.6, -0.6, True)
    for _ in range(1000):
        output = planar.planar_step(settings, state, inp, 0.002)
        forces.append(math.hypot(output.force_x, output.force_y))
    assert max(forces) > 10.0
    assert max(forces[200:]) < 1e-6
