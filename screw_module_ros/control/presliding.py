# SPDX-License-Identifier: Apache-2.0
"""Friction feed-forward that follows position, as presliding does (Dahl 1968; thesis 6.3.1).

A feed-forward that goes through zero with the velocity is negative damping there: 2 N over 2 mm/s
are 1000 Ns/m, and a handle at rest swings. Friction itself does not do that. While a handle barely
moves, friction is a spring, so what makes up for it is one too: per length dx of motion the force
goes from where it is towards the level of that direction, over a way of level / stiffness,

    up:   h' = L+ - (L+ - h) exp(-s dx / L+)        down:  h' = -L- + (h + L-) exp(s dx / L-).

With a stiffness s below that of the module's own presliding the sum stays a positive spring, and a
handle at rest rests. It takes and gives no energy at standstill and needs no velocity there.
"""

from __future__ import annotations

import math

from .friction import FrictionModel, friction_force

MOVING = 0.005  # [m/s] slower motion tells nothing of the level
DOUBT_TIME = 0.1  # [s] in which a model is doubted that promises too much
TRUST_TIME = 1.0  # [s] in which it is trusted again
NEAR_ENOUGH = 1.05  # times what was found: the model's own scatter does not lower it
SMALLEST_LEVEL = 0.1
"""A level below counts as this [N]: the way over which the force turns round stays finite."""


def ratio_step(ratio: float, modelled: float, found: float, velocity: float, dt: float) -> float:
    """Return found over modelled friction, averaged while the handle moves; 1 at first.

    modelled, found [N]; velocity [m/s]. A model that promises more friction than there is gives the
    handle energy: fed forward, it swings on any spring (thesis 6.3.1 feeds forward 90 % for that).
    """
    if abs(velocity) < MOVING or abs(modelled) < 1.0 or modelled * velocity <= 0.0:
        return ratio
    now = min(2.0, max(0.0, found / modelled))
    return ratio + (now - ratio) * min(1.0, dt / (DOUBT_TIME if now < ratio else TRUST_TIME))


def trusted(ratio: float) -> float:
    """Return the share of the model to use, at most 1, for a ratio of `ratio_step`."""
    return min(1.0, NEAR_ENOUGH * ratio)


def presliding_step(
    model: FrictionModel,
    stiffness: float,
    force: float,
    position: float,
    velocity: float,
    travelled: float,
) -> float:
    """Return the modelled friction that opposes the motion, up positive [N], at full size.

    stiffness: of the turn-round [N/m]; force: returned last [N]; position [m], velocity [m/s]: now;
    travelled: since the last step, up positive [m].
    """
    if travelled == 0.0:
        return force
    speed = max(abs(velocity), 1e-3 * model.ramp_speed)
    way = 1.0 if travelled > 0.0 else -1.0
    level = max(abs(friction_force(model, position, way * speed)), SMALLEST_LEVEL)
    kept = math.exp(-stiffness * abs(travelled) / level)
    return way * level + (force - way * level) * kept
