# SPDX-License-Identifier: Apache-2.0
"""Friction feed-forward that follows position, as presliding does (Dahl 1968; thesis 6.3.1).

A feed-forward that is proportional to the velocity near zero is negative damping: 2 N over 2 mm/s
are 1000 Ns/m, and a handle at rest oscillates. Real friction is a spring while the handle barely
moves, so the feed-forward is one too: with each length dx of motion the force h approaches the
level L of that direction, over a length of L / s,

    up:   h' = L+ - (L+ - h) exp(-s dx / L+)        down:  h' = -L- + (h + L-) exp(s dx / L-).

With a stiffness s below that of the module's own presliding, the sum of both remains a positive
spring and a handle at rest stays at rest. At standstill the feed-forward exchanges no energy and
needs no velocity.
"""

from __future__ import annotations

import math

from .friction import FrictionModel, friction_force

MOVING = 0.005  # [m/s] slower motion gives no information on the level
DOUBT_TIME = 0.1  # [s] time constant with which the ratio falls, for a model that predicts too much
TRUST_TIME = 1.0  # [s] time constant with which the ratio rises again
NEAR_ENOUGH = 1.05  # model / found up to which the model is used in full: its own scatter
SMALLEST_LEVEL = 0.1
"""Smallest level [N]: keeps the length over which the force reverses finite."""


def ratio_step(ratio: float, modelled: float, found: float, velocity: float, dt: float) -> float:
    """Return found / modelled friction, averaged while the handle moves; start with 1.

    modelled, found [N]; velocity [m/s]. A model that predicts too much friction adds energy: with
    that feed-forward the handle oscillates on any spring. For this reason the thesis feeds forward
    90 % (6.3.1).
    """
    if abs(velocity) < MOVING or abs(modelled) < 1.0 or modelled * velocity <= 0.0:
        return ratio
    now = min(2.0, max(0.0, found / modelled))
    return ratio + (now - ratio) * min(1.0, dt / (DOUBT_TIME if now < ratio else TRUST_TIME))


def trusted(ratio: float) -> float:
    """Return the share of the model to use, at most 1, given the ratio from `ratio_step`."""
    return min(1.0, NEAR_ENOUGH * ratio)


def presliding_step(
    model: FrictionModel,
    stiffness: float,
    force: float,
    position: float,
    velocity: float,
    travelled: float,
) -> float:
    """Return the force that compensates all of the modelled friction [N], up positive.

    stiffness: of the reversal [N/m]; force: last returned value [N]; position [m], velocity [m/s]:
    now; travelled: since the last step, up positive [m].
    """
    if travelled == 0.0:
        return force
    speed = max(abs(velocity), 1e-3 * model.ramp_speed)
    way = 1.0 if travelled > 0.0 else -1.0
    level = max(abs(friction_force(model, position, way * speed)), SMALLEST_LEVEL)
    kept = math.exp(-stiffness * abs(travelled) / level)
    return way * level + (force - way * level) * kept
