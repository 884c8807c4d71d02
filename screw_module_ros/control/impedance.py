# SPDX-License-Identifier: Apache-2.0
"""Spring and damper between the set point and the handle (thesis 3.3, eqs 3.3 and 6.1)."""

from __future__ import annotations


def spring_damper(
    stiffness: float,
    damping: float,
    position_error: float,
    velocity_error: float,
) -> float:
    """Return the force on the handle [N] towards the set point.

    stiffness [N/m], damping [Ns/m] (negative values assist motion, thesis 6.4.1), position_error
    and velocity_error: desired minus measured [m], [m/s].
    """
    return stiffness * position_error + damping * velocity_error
