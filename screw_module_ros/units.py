# SPDX-License-Identifier: Apache-2.0
"""Torque in the unit of a CiA 402 drive: whole per mille of its rated torque (6071, 6077).

This is separate from the drivers, because a simulation without a bus must round in the same way.
"""

from __future__ import annotations

PER_MILLE = 1000.0
LARGEST_PER_MILLE = 32767
"""Objects 6071 and 6077 are signed and 16 bits wide."""


def to_per_mille(torque: float, rated_torque: float) -> int:
    """Return a torque [Nm] in whole per mille of the rated torque [Nm], clamped to 16 bits."""
    per_mille = round(torque / rated_torque * PER_MILLE)
    return max(-LARGEST_PER_MILLE, min(LARGEST_PER_MILLE, per_mille))


def from_per_mille(per_mille: int, rated_torque: float) -> float:
    """Return per mille of the rated torque [Nm] as a torque [Nm]."""
    return per_mille * rated_torque / PER_MILLE
