# SPDX-License-Identifier: Apache-2.0
"""Damper at standstill: keeps a held handle still in OBSERVER (thesis 7.1).

An observer that cancels friction hunts against stiction, as every integral action does: the handle
creeps, slips, and creeps back. The law stops the estimate at rest, but a creep faster than that
goes on, and spring and hand have too little damping to end it. In motion a damper is felt, at rest
it is not: this one acts only while the handle has been slow of late.

Its share falls with the largest recent speed, at once, so that a handle that starts to move is free
of it: the force never exceeds a quarter of D `MOVING`. The share returns as that speed is
forgotten (`hold.FORGET`), long after a reversal. The force is always against the motion.
"""

from __future__ import annotations

from .hold import hold_step

MOVING = 6e-3
"""Largest recent speed from which nothing is left of the damper [m/s]; slips of the hunting are
slower."""


def standstill_share(fastest: float) -> float:
    """Return the share of the damper that acts, 0 to 1; fastest: largest recent speed [m/s]."""
    return max(0.0, 1.0 - fastest / MOVING)


def standstill_step(
    damping: float, fastest: float, velocity: float, dt: float
) -> tuple[float, float]:
    """Return the damper's force [N], and the largest recent speed [m/s], its only memory.

    damping: D, of a handle at rest [Ns/m]; fastest: from the last step [m/s]; velocity: of the nut
    [m/s]; dt [s].
    """
    fastest = hold_step(fastest, velocity, dt)
    return -damping * standstill_share(fastest) * velocity, fastest
