# SPDX-License-Identifier: Apache-2.0
"""The example of an arm of one's own: the robot homes, moves and lets be moved with it."""

import ast
import math
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).parents[2] / "examples" / "own_arm"


@pytest.fixture
def example(importing):
    """What the example's README runs."""
    return importing("own_arm", "try_it")


def test_the_arm_homes_and_draws_a_square(example):
    places, torques = example.drawn()
    for corner, place in zip(example.CORNERS, places, strict=True):
        assert math.dist(corner, place) < 0.002
    assert max(abs(torque) for pair in torques for torque in pair) > 0.5


def test_plant_and_arm_share_nothing():
    """A simulation that shares formulas with the controller proves nothing."""
    tree = ast.parse((EXAMPLE / "serial_plant.py").read_text(encoding="utf-8"))
    named = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert not any("control" in name or "serial_arm" in name for name in named)
