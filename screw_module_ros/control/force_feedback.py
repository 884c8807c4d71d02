# SPDX-License-Identifier: Apache-2.0
"""Proportional feedback of the handle force (thesis 6.4.3, eqs 6.3 to 6.8).

When the impedance is as wanted, the patient's force balances the desired one: Fp = -Fpd (eq 6.5).
What is left over is what friction and inertia take, and the loop divides it by 1 + Kf (eq 6.8).
The law is proportional: it has no memory, so a limit that acts downstream winds nothing up.
"""

from __future__ import annotations


def feedback_force(gain: float, desired_force: float, handle_force: float, largest: float) -> float:
    """Return the force to add to the command [N] (eq 6.6), held within +-largest [N].

    gain: Kf [1]; desired_force: Fpd, what the impedance asks for [N]; handle_force: Fp, patient on
    robot through the 30 Hz filter [N].
    """
    force = gain * (desired_force + handle_force)
    return min(largest, max(-largest, force))
