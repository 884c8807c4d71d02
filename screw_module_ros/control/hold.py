# SPDX-License-Identifier: Apache-2.0
"""Whether a hand holds the handle, by the force on it.

A friction model that is right takes away the friction that would bring a released handle to rest on
its spring. While nobody holds the handle, the law puts a damper in its place; nobody feels it. The
largest recent force decides, not the present one: the force of a hand that moves passes through
zero in the middle of the spring.
"""

from __future__ import annotations

import math

FIRM = 0.8  # [N] from which a hand holds the handle
FORGET = 0.8  # [s] time constant with which the largest size falls


def hold_step(largest: float, value: float, dt: float) -> float:
    """Return the largest recent size of a value, dt [s] after the last one.

    value: filtered, as the handle force [N]; the result has its unit.
    """
    return max(abs(value), largest * math.exp(-dt / FORGET))


def free_share(largest: float) -> float:
    """Return how far nobody holds the handle, 0 to 1; largest: from `hold_step` [N]."""
    return max(0.0, 1.0 - largest / FIRM)
