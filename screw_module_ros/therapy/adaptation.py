# SPDX-License-Identifier: Apache-2.0
"""Performance-based progressive therapy: assistance adapts to the patient (krebs2003).

Two parameters adapt, each by a metric that is positive if the patient needs less assistance:

- duration T of the back wall's way, by speed = 0.65 min(0, pm2a) + 6.0 pm2b: a patient who lags or
  whom the robot moves gets more time, one who leads less: T <- T - a (Tmax - Tmin) mean(speed);
- stiffness K of the side walls, by accuracy: -8 m if m is positive, else -20 m, with
  m = 2.65 sqrt(pm3) - 0.00008 K. A larger deviation than K allows gives stiffer walls, a smaller
  one softer walls: K <- K - a (Kmax - Kmin) mean(accuracy).

An arm that does nothing can lead the wall, where its own spring pulls it, and keeps to the line. So
nothing is taken away after circuits in which the patient's effort, by their median, is less than
`least_effort` (ours).

The gain a increases with the consistency of the last three circuits. A circuit's level is the sign
of its mean metric, zero within the dead band of 0.01.

The coefficients, levels, gains and the circuits after which they act are those of an InMotion
robot (imtclock in docs/references.md); the bounds are ours. At rest m = 0: walls settle at
K = 33 125 N/m^2 times the rms distance.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from statistics import median
from typing import Annotated, Any, NamedTuple

from ..control.limits import clamp
from ..settings import Setting

POWER_WEIGHT = 0.65  # [1/W]
LEAD_WEIGHT = 6.0  # [1/m]
STRAY_WEIGHT = 2.65  # [1/m]
STIFFNESS_WEIGHT = 0.00008  # [m/N]
MORE_WEIGHT, LESS_WEIGHT = 8.0, 20.0  # of the accuracy metric, for more or less stiffness
DEAD_BAND = 0.01
GAINS = {-3: 1.0, -2: 0.5, -1: 0.25, 0: 0.25, 1: 0.5, 2: 1.0, 3: 2.0}
LEVELS = 3  # number of circuits in the sum of levels
AFTER_CIRCUITS = (1, 2, 3, 4, 5, 8, 11, 14, 17)


class AdaptationBounds(NamedTuple):
    """Bounds of the adaptation. Ours: those of the original robot are not public."""

    shortest: Annotated[float, Setting("shortest duration of the back wall", "s", 0.3, 10.0)] = 0.7
    longest: Annotated[float, Setting("longest duration of the back wall", "s", 0.3, 10.0)] = 3.0
    softest: Annotated[float, Setting("softest side walls", "N/m", 0.0, 1000.0)] = 25.0
    stiffest: Annotated[float, Setting("stiffest side walls", "N/m", 0.0, 1000.0)] = 300.0
    least_effort: Annotated[
        float, Setting("effort in a circuit below which nothing is taken away, 0 = no such rule",
                       "", 0.0, 1.0)
    ] = 0.0

    def flaw(self) -> str:
        """Return which range is empty, nothing if none is."""
        for low, high in (("shortest", "longest"), ("softest", "stiffest")):
            if getattr(self, low) >= getattr(self, high):
                return (
                    f"{low} = {getattr(self, low):g} must be less than "
                    f"{high} = {getattr(self, high):g}"
                )
        return ""


class Assistance(NamedTuple):
    """Adapted parameters: duration of the back wall's way [s], side wall stiffness [N/m]."""

    duration: float
    side_stiffness: float


USUAL = Assistance(0.0, 0.0)
"""Asks for nothing: a session begins as its protocol says."""


def beginning(bounds: AdaptationBounds | None, usual: Assistance, asked: Assistance) -> Assistance:
    """Return with what a session begins: what is asked for, within what its protocol may adapt.

    usual: of the protocol, which also counts where it adapts nothing.
    """
    if bounds is None or not (asked.duration > 0.0 and asked.side_stiffness >= 0.0):
        return usual
    return Assistance(
        clamp(asked.duration, bounds.shortest, bounds.longest),
        clamp(asked.side_stiffness, bounds.softest, bounds.stiffest),
    )


class Circuit(NamedTuple):
    """Mean speed and accuracy metrics of a circuit, positive = less assistance needed.

    effort: median of its movements, NaN where it is not known.
    """

    speed: float
    accuracy: float
    effort: float = math.nan


class Change(NamedTuple):
    """A change of assistance: number of the circuit before it, old and new values, reason.

    support_before, support: of the arm, by a fade [N], NaN = there is none.
    """

    circuit: int
    before: Assistance
    after: Assistance
    reason: str
    support_before: float = math.nan
    support: float = math.nan

    def row(self, block: int) -> dict[str, Any]:
        """Return it by the names of AssistanceChange.msg; block: number of its block."""
        return {
            "block": block,
            "circuit": self.circuit,
            "duration_before": self.before.duration,
            "duration": self.after.duration,
            "side_stiffness_before": self.before.side_stiffness,
            "side_stiffness": self.after.side_stiffness,
            "support_before": self.support_before,
            "support": self.support,
            "reason": self.reason,
        }


def circuit_of(movements: Sequence[Mapping[str, float]], stiffness: float) -> Circuit:
    """Return the metrics of one circuit from the results of its movements.

    stiffness: of the side walls during the circuit [N/m]. Raises ValueError without a movement.
    """
    if not movements:
        raise ValueError("circuit_of: a circuit without movements has no metrics")
    return Circuit(
        math.fsum(speed_metric(m) for m in movements) / len(movements),
        math.fsum(accuracy_metric(m, stiffness) for m in movements) / len(movements),
        _median([m.get("effort", math.nan) for m in movements]),
    )


def _median(values: Sequence[float]) -> float:
    """Return the median of the known values, NaN if there is none."""
    known = [value for value in values if math.isfinite(value)]
    return median(known) if known else math.nan


def speed_metric(movement: Mapping[str, float]) -> float:
    """Return the speed metric of a movement [1], positive if less assistance is needed."""
    return POWER_WEIGHT * min(0.0, movement["pm2a"]) + LEAD_WEIGHT * movement["pm2b"]


def accuracy_metric(movement: Mapping[str, float], stiffness: float) -> float:
    """Return the accuracy metric of a movement [1], positive if softer walls are sufficient.

    stiffness: of the side walls [N/m].
    """
    stray = STRAY_WEIGHT * math.sqrt(movement["pm3"]) - STIFFNESS_WEIGHT * stiffness
    return -(MORE_WEIGHT if stray > 0.0 else LESS_WEIGHT) * stray


def gain(metrics: Sequence[float]) -> float:
    """Return the gain a [1] from the mean metrics of all circuits, in order."""
    return GAINS[sum(_level(metric) for metric in metrics[-LEVELS:])]


def _level(metric: float) -> int:
    return 0 if abs(metric) <= DEAD_BAND else (1 if metric > 0.0 else -1)


def adapted(
    bounds: AdaptationBounds,
    before: Assistance,
    circuits: Sequence[Circuit],
    has_sides: bool = True,
) -> Change | None:
    """Return the change after the latest circuit, None if the assistance stays the same.

    circuits: all circuits of this block, in order. The means are over those since the last change.
    has_sides: the slot has side walls. On one axis it has none, the accuracy says nothing, and the
    stiffness, which then is the front wall's, stays.
    """
    number = len(circuits)
    if number not in AFTER_CIRCUITS:
        return None
    earlier = [after for after in AFTER_CIRCUITS if after < number]
    recent = circuits[earlier[-1] if earlier else 0 :]
    speed = math.fsum(c.speed for c in recent) / len(recent)
    accuracy = math.fsum(c.accuracy for c in recent) / len(recent)
    effort = _median([c.effort for c in recent])
    withheld = ""
    if bounds.least_effort > 0.0 and effort < bounds.least_effort and max(speed, accuracy) > 0.0:
        speed, accuracy = min(speed, 0.0), min(accuracy, 0.0)
        withheld = f"; nothing is taken away, as the robot does the work (effort {effort:.0%})"
    by_speed = gain([c.speed for c in circuits])
    by_accuracy = gain([c.accuracy for c in circuits])
    range_t, range_k = bounds.longest - bounds.shortest, bounds.stiffest - bounds.softest
    after = Assistance(
        clamp(before.duration - by_speed * range_t * speed, bounds.shortest, bounds.longest),
        clamp(
            before.side_stiffness - by_accuracy * range_k * accuracy,
            bounds.softest,
            bounds.stiffest,
        ),
    )
    if not has_sides:
        after = after._replace(side_stiffness=before.side_stiffness)
        reason = _about_time(before, after, speed)
    else:
        reason = _reason(before, after, speed, accuracy)
    return Change(number, before, after, reason + withheld)


def _about_time(before: Assistance, after: Assistance, speed: float) -> str:
    time = _unchanged("time", speed, "shortest", "longest")
    if after.duration < before.duration:
        time = "less time, as the hand led the wall"
    elif after.duration > before.duration:
        time = "more time, as the hand lagged or was moved"
    return f"{time} (metric {speed:+.3f})"


def _reason(before: Assistance, after: Assistance, speed: float, accuracy: float) -> str:
    walls = _unchanged("side walls", accuracy, "softest", "stiffest")
    if after.side_stiffness < before.side_stiffness:
        walls = "softer side walls, as the hand kept to the line"
    elif after.side_stiffness > before.side_stiffness:
        walls = "stiffer side walls, as the hand strayed"
    return f"{_about_time(before, after, speed)}; {walls} (metric {accuracy:+.3f})"


def _unchanged(what: str, metric: float, least: str, most: str) -> str:
    """Return why a parameter did not change: the metric is zero, or a bound limits it."""
    if metric == 0.0:
        return f"{what} as before"
    return f"{what} already the {least if metric > 0.0 else most} allowed"
