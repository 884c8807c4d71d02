# SPDX-License-Identifier: Apache-2.0
"""The minimum-jerk way from one point to another (Flash and Hogan 1985), as a share of the way.

A reach of length L in time T has its largest speed, 1.875 L/T, half way.
"""

from __future__ import annotations

PEAK_SPEED = 1.875
"""Largest speed of a reach over its mean speed."""


def way(share: float) -> float:
    """Return how much of the way is behind at a share of the time, 0 to 1; held beyond both."""
    s = min(max(share, 0.0), 1.0)
    return s * s * s * (10.0 + s * (6.0 * s - 15.0))


def pace(share: float) -> float:
    """Return the speed over the mean speed at a share of the time; zero beyond both ends."""
    s = min(max(share, 0.0), 1.0)
    return 30.0 * (s * (1.0 - s)) * (s * (1.0 - s))
