# SPDX-License-Identifier: Apache-2.0
"""The compiled twins of the laws give what the plain functions give, and keep the same memory."""

import math
import random

import pytest

from screw_module_ros.calibration.module import thesis_friction
from screw_module_ros.compiled import compiled, packed
from screw_module_ros.control import planar, vertical
from screw_module_ros.control.modes import MODE_NAMES
from screw_module_ros.control.planar import planar_step
from screw_module_ros.control.vertical import VerticalInput, vertical_step

pytestmark = pytest.mark.long

MODEL = thesis_friction()


def vertical_twin(p, model, packed_state, inp, dt):
    return vertical_step(p, model, packed_state[0], inp, dt)


def planar_twin(p, packed_state, inp, dt):
    return planar_step(p, packed_state[0], inp, dt)


def test_vertical_law():
    chance = random.Random(1)
    settings = vertical.VerticalSettings(damping=10.0, observer_inertia=0.7)
    plain = vertical.initial_state(settings)
    twin, fast = packed(plain), compiled(vertical_twin)
    for _ in range(300):
        inp = VerticalInput(
            chance.choice(list(MODE_NAMES)),
            chance.uniform(-0.01, 0.37),
            chance.choice([chance.uniform(-1.0, 1.0), math.nan]) if chance.random() < 0.1 else 0.2,
            chance.uniform(-50.0, 50.0),
            chance.choice([math.nan, 0.2]),
            chance.choice([math.nan, 0.1]),
            chance.random() < 0.95,
        )
        expected = vertical_step(settings, MODEL, plain, inp, 0.001)
        found = fast(settings, MODEL, twin, inp, 0.001)
        assert tuple(found) == pytest.approx(tuple(expected), abs=1e-9)


def test_planar_law():
    chance = random.Random(2)
    settings = planar.PlanarSettings(force_gain=9.0)
    plain = planar.initial_state(settings)
    twin, fast = packed(plain), compiled(planar_twin)
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
            0.0,
            0.0,
            0.0,
            chance.choice([math.nan, 60.0]) if chance.random() < 0.1 else 5.0,
            chance.uniform(-20.0, 20.0),
        )
        expected = planar_step(settings, plain, inp, 0.002)
        found = fast(settings, twin, inp, 0.002)
        assert tuple(found) == pytest.approx(tuple(expected), abs=1e-9)
