# SPDX-License-Identifier: Apache-2.0
"""True values of the simulated module, for the report only; the identification never uses them."""

from __future__ import annotations

from ...plant.settings import WorldSettings


def true_weight(world: WorldSettings) -> float:
    """Return the weight of the vertically moving parts [N]."""
    return world.vertical.moving_mass * world.vertical.gravity


def true_mass(world: WorldSettings) -> float:
    """Return the mass felt at the handle [kg]."""
    return world.vertical.moving_mass + world.vertical.turning_mass
