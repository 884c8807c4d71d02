# SPDX-License-Identifier: Apache-2.0
"""Limit of the planar force that the torques of both joints press on the hand (thesis 2.1.1).

The joints' limits act on torques. Near a stretched arm a small torque is a large force: 1 cm behind
the far corners of the workspace, 8 and 16 Nm of a joint's stop are 160 N at the hand.
"""

from __future__ import annotations

import math

from ..geometry import PlanarArm

SINGULAR = 0.02
"""Sine of the angle between the links up to which the arm counts as stretched or folded [1]: the
torque that leads out of there does not vanish."""


def within_at_hand(
    largest: float,
    arm: PlanarArm,
    jacobian: tuple[float, float, float, float],
    torques: tuple[float, float],
) -> tuple[float, float]:
    """Return the torques [Nm], scaled down to a force at the hand of `largest` [N] at most.

    jacobian: at the present angles, from `geometry.jacobian` [m]; torques: of shoulder and elbow
    [Nm]. The force is J^-T of the torques, here without a division by the determinant.
    """
    shoulder, elbow = torques
    x_s, x_e, y_s, y_e = jacobian
    size = math.hypot(y_e * shoulder - y_s * elbow, x_s * elbow - x_e * shoulder)
    least = SINGULAR * arm.upper_arm * arm.forearm
    allowed = largest * max(abs(x_s * y_e - x_e * y_s), least)
    kept = allowed / size if size > allowed else 1.0
    return shoulder * kept, elbow * kept
