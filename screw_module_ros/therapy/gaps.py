# SPDX-License-Identifier: Apache-2.0
"""Missing samples of the hand, from the tick numbers alone.

A sample carries the tick number of its encoder sample. If the rate of `endpoint_state` divides that
of the encoder samples, each step of the numbers is the same, and a longer one is a gap. Otherwise
two steps alternate: encoder samples at 250 Hz, shown at 200 Hz, give 1, 1, 1, 2, 1, 1, 1, 2. There
the longer step is due, because it comes at even distances; losses do not. Losses at even distances
look like another rate, and only `session verify` can find them, in the topics that follow ticks.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from ..samples import sequence_gap
from .hand import HandSample

_LEAST = 4  # long steps at even distances; fewer may be losses
_FARTHEST = 50  # steps between them: 24 for 625 Hz; rarer long steps count as losses
_EVEN = 0.9  # share of the distances that must be even, losses are the others


class Gap(NamedTuple):
    """Missing samples: sequence number before them, number of them."""

    after: int
    missing: int


class _Schedule(NamedTuple):
    """Steps that are due.

    longest, mean: of the steps [ticks]; nearest: fewest steps from one longest step to the next, 0
    if that has no least number.
    """

    longest: int
    mean: float
    nearest: int = 0


def gaps_of(samples: Sequence[HandSample]) -> tuple[Gap, ...]:
    """Return the gaps between samples. A sample that repeats a number counts for nothing."""
    pairs = list(pairwise(sample.sequence for sample in samples))
    numbered = [(before, sequence_gap(before, after) + 1) for before, after in pairs]
    numbered = [(before, step) for before, step in numbered if step > 0]
    if not numbered:
        return ()
    schedule = _schedule([step for _, step in numbered])
    gaps, since = [], math.inf
    for before, step in numbered:
        since += 1
        if missing := _missing(schedule, step, since):
            gaps.append(Gap(before, missing))
            since += missing
        elif step == schedule.longest:
            since = 0
    return tuple(gaps)


def _missing(schedule: _Schedule, step: int, since: float) -> int:
    """Return the samples missing in a step; since: steps since the last due longest one."""
    if step > schedule.longest:
        return max(1, round(step / schedule.mean) - 1)
    return 1 if step == schedule.longest and since < schedule.nearest else 0


def _schedule(steps: list[int]) -> _Schedule:
    """Return the due steps; the most frequent one alone if no other comes at even distances."""
    counts = Counter(steps)
    (usual, count), *others = sorted(counts.items(), key=lambda each: (-each[1], each[0]))
    for other, more in others[:1]:
        is_next = abs(other - usual) == math.gcd(other, usual)
        if is_next and more >= _LEAST and (nearest := _even(steps, other)):
            mean = (usual * count + other * more) / (count + more)
            return _Schedule(max(usual, other), mean, nearest if other > usual else 0)
    return _Schedule(math.ceil(1.5 * usual) - 1, usual)


def _even(steps: list[int], step: int) -> int:
    """Return the fewest steps from one `step` to the next if they are even, otherwise 0.

    Even: almost all distances are one of two neighbouring numbers.
    """
    at = [index for index, each in enumerate(steps) if each == step]
    distances = Counter(b - a for a, b in pairwise(at))
    nearest = max(distances, key=lambda each: distances[each] + distances[each + 1])
    even = distances[nearest] + distances[nearest + 1]
    return nearest if nearest <= _FARTHEST and even >= _EVEN * (len(at) - 1) else 0
