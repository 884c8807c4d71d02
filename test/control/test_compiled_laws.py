# SPDX-License-Identifier: Apache-2.0
"""The compiled twins of the laws give what the plain functions give."""

import math
import random

import pytest

from screw_module_ros.calibration.friction_file import thesis_friction
from screw_module_ros.compiled import compiled
from screw_module_ros.control import planar, vertical
from screw_module_ros.control.vertical_state import VerticalInput, initial_state

pytestmark = pytest.mark.long

MODEL = thesis_friction()


def test_vertical_law():
    chance = random.Random(1)
    settings = vertical.VerticalSettings(damping=10.0)
    plain = twin = initial_state(settings)
    fast = compiled(vertical.vertical_step)
    for _ in range(300):
        inp = VerticalInput(
            chance.randint(0, 4),
            chance.uniform(-0.01, 0.37),
            chance.choice([chance.uniform(-1.0, 1.0), math.nan]) if chance.random() < 0.1 else 0.2,
            chance.uniform(-50.0, 50.0),
            chance.choice([math.nan, 0.2]),
            chance.choice([math.nan, 0.1]),
            chance.random() < 0.95,
        )
        expected, plain = vertical.vertical_step(settings, MODEL, plain, inp, 0.001)
        found, twin = fast(settings, MODEL, twin, inp, 0.001)
        assert tuple(found) == pytest.approx(tuple(expected), abs=1e-9)


def test_planar_law():
    chance = random.Random(2)
    settings = planar.PlanarSettings()
    plain = twin = planar.initial_state(settings)
    fast = compiled(planar.planar_step)
    for _ in range(300):
        inp = planar.PlanarInput(
            chance.uniform(-0.2, 1.6),
            chance.uniform(1.5, 2.9),
            chance.uniform(-2.0, 2.0),
            chance.uniform(-2.0, 2.0),
            chance.choice([math.nan, 0.1]),
            0.0,
            0.0,
            math.nan,
            chance.random() < 0.95,
        )
        expected, plain = planar.planar_step(settings, plain, inp, 0.002)
        found, twin = fast(settings, twin, inp, 0.002)
        assert tuple(found) == pytest.approx(tuple(expected), abs=1e-9)
