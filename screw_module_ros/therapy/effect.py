# SPDX-License-Identifier: Apache-2.0
"""Effect size: difference of two groups of movements."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import mean, variance


def effect_size(one: Sequence[float], other: Sequence[float]) -> float:
    """Return Cohen's d [1]: mean of `other` minus mean of `one`, over the pooled deviation.

    The pooled deviation weights the groups by their sizes (Cohen 1988, 2.5.1). NaN for fewer than
    two values in a group, or if all values equal the means of their groups.
    """
    degrees = len(one) + len(other) - 2
    if min(len(one), len(other)) < 2:
        return math.nan
    spread = (len(one) - 1) * variance(one) + (len(other) - 1) * variance(other)
    pooled = math.sqrt(spread / degrees)
    return (mean(other) - mean(one)) / pooled if pooled > 0.0 else math.nan
