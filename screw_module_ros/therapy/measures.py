# SPDX-License-Identifier: Apache-2.0
"""Performance measures pm1 to pm4 of one assisted movement, for the adaptation (Krebs 2003)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from ..control.minimum_jerk import way
from .line import Line
from .samples import HandSample


class Measures(NamedTuple):
    """Performance measures of one movement.

    pm1: the patient started it before the end of the wait; pm2a: mean of handle force times
    velocity along the line while behind the back wall [W], negative if the robot moves the hand;
    pm2b: mean lead over the back wall [m]; pm3: mean square of the distance from the line [m^2];
    pm4: largest distance along the line [m].
    """

    pm1: bool
    pm2a: float
    pm2b: float
    pm3: float
    pm4: float


def measures(
    samples: Sequence[HandSample], line: Line, duration: float, start_ns: int, initiated: bool
) -> Measures:
    """Return the measures of the samples from the start of a movement to its end.

    duration: of the back wall's way [s]; start_ns: stamp of the start [ns]; initiated: pm1. After
    its arrival the wall stays at the target, so that a late hand lags. Without a sample pm2a and
    pm2b are zero, which means no change of the assistance.
    """
    length = line.length
    leads, powers, off, farthest = [], [], [], 0.0
    for sample in samples:
        since = (sample.time_ns - start_ns) * 1e-9
        gone = line.gone(sample.position)
        farthest = max(farthest, gone)
        off.append(line.off(sample.position))
        lead = gone - length * way(since / duration)
        leads.append(lead)
        if lead < 0.0:
            powers.append(_power(sample, line))
    return Measures(
        pm1=initiated,
        pm2a=_mean(powers),
        pm2b=_mean(leads),
        pm3=_mean(off),
        pm4=farthest,
    )


def _power(sample: HandSample, line: Line) -> float:
    """Return handle force times velocity along the line [W], zero without a valid force."""
    power = line.along(sample.force) * line.along(sample.velocity)
    return power if math.isfinite(power) else 0.0


def _mean(values: list[float]) -> float:
    return math.fsum(values) / len(values) if values else 0.0
