# SPDX-License-Identifier: Apache-2.0
"""Missing samples of the hand, from their numbers alone.

The numbers of `endpoint_state` rise by one. In older bags they are those of the encoder's ticks and
rise by a fixed step: the most frequent one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from ..samples import sequence_gap
from .hand import HandSample


class Gap(NamedTuple):
    """Missing samples: sequence number before them, number of them."""

    after: int
    missing: int


def gaps_of(samples: Sequence[HandSample]) -> tuple[Gap, ...]:
    """Return the gaps between samples. A sample that repeats a number counts for nothing."""
    pairs = pairwise(sample.sequence for sample in samples)
    steps = [(before, sequence_gap(before, after) + 1) for before, after in pairs]
    counts = Counter(step for _, step in steps if step > 0)
    usual = 1 if 1 in counts else max(counts, key=lambda step: (counts[step], -step), default=1)
    gaps = (Gap(before, round(step / usual) - 1) for before, step in steps)
    return tuple(gap for gap in gaps if gap.missing > 0)
