# SPDX-License-Identifier: Apache-2.0
"""What identification cannot see: the simulated module's own values, for the report alone."""

from __future__ import annotations

import math

import numpy as np

from ...compiled import compiled
from ...plant.friction import steady_level
from ...plant.settings import WorldSettings
from ..friction_map import MAPS


def true_weight(world: WorldSettings) -> float:
    """Return the weight of what moves up and down [N]."""
    return world.vertical.moving_mass * world.vertical.gravity


def true_mass(world: WorldSettings) -> float:
    """Return the mass that a hand at the handle moves [kg]."""
    return world.vertical.moving_mass + world.vertical.turning_mass


def true_map(world: WorldSettings, speeds: np.ndarray, centres_mm: np.ndarray) -> dict:
    """Return the force at constant speed [N] for each of `MAPS`, shape (speeds, bins).

    speeds [m/s]; centres_mm: heights [mm]. Up the screw is positive, as in `friction_map`.
    """
    level = compiled(steady_level)
    turn_rate, weight = 2.0 * math.pi / world.vertical.lead, true_weight(world)
    maps = {}
    for name in MAPS:
        sign = 1.0 if name.startswith("up") else -1.0
        upright = -1.0 if name.endswith("inverted") else 1.0
        against = sign * upright > 0.0
        maps[name] = np.array(
            [
                [
                    sign * level(world.friction, turn_rate, z / 1e3, speed, against)
                    + upright * weight
                    for z in centres_mm
                ]
                for speed in speeds
            ]
        )
    return maps
