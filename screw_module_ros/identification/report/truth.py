# SPDX-License-Identifier: Apache-2.0
"""What identification cannot see: the simulated module's own values, for the report alone."""

from __future__ import annotations

from ...plant.settings import WorldSettings


def true_weight(world: WorldSettings) -> float:
    """Return the weight of what moves up and down [N]."""
    return world.vertical.moving_mass * world.vertical.gravity


def true_mass(world: WorldSettings) -> float:
    """Return the mass that a hand at the handle moves [kg]."""
    return world.vertical.moving_mass + world.vertical.turning_mass
