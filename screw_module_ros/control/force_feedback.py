# SPDX-License-Identifier: Apache-2.0
"""Proportional feedback of the handle force (thesis 6.4.3, eqs 6.3 to 6.8).

With the desired impedance the patient's force balances the desired force: Fp = -Fpd (eq 6.5).
The remainder is due to friction and inertia; the feedback divides it by 1 + Kf (eq 6.8).
The law is proportional and has no memory, so a limit downstream causes no windup.
"""

from __future__ import annotations


def feedback_force(gain: float, desired_force: float, handle_force: float, largest: float) -> float:
    """Return the force to add to the command [N] (eq 6.6), held within +-largest [N].

    gain: Kf [1]; desired_force: Fpd, the force of the impedance [N]; handle_force: Fp, force of the
    patient on the robot after the filter `force_cutoff` [N].
    """
    force = gain * (desired_force + handle_force)
    return min(largest, max(-largest, force))
