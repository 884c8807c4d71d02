# SPDX-License-Identifier: Apache-2.0
"""The minimum-jerk reach from one point to another (flashhogan1985), normalized.

A reach of length L in time T has its largest speed, 1.875 L/T, half way.
"""

from __future__ import annotations

PEAK_SPEED = 1.875
"""Largest speed of a reach over its mean speed."""


def way(share: float) -> float:
    """Return the share of the way covered at a share of the time, clamped to 0 to 1."""
    s = min(max(share, 0.0), 1.0)
    return s * s * s * (10.0 + s * (6.0 * s - 15.0))


def pace(share: float) -> float:
    """Return speed / mean speed at a share of the time; zero outside 0 to 1."""
    s = min(max(share, 0.0), 1.0)
    return 30.0 * (s * (1.0 - s)) * (s * (1.0 - s))
