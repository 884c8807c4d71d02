# SPDX-License-Identifier: Apache-2.0
"""The force that a hand feels beyond the spring it is asked to feel, while it moves.

With a perfect impedance controller the patient feels a spring: the force at height z is K (z - z0),
in both directions of motion; with a damper it is K (z - z0) + B z'. The offset is the measured
force minus that: friction, the inertia of the screw, and the residual of their compensation (thesis
6.1, 6.4.2, 6.4.3: B is 0 there). Taken from the spring alone it contains the damper too. All forces
are those of the patient on the robot, up positive.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

MOTION_THRESHOLD = 0.020  # [m/s] ours: as slow as 5.3.2 still uses
"""Below this speed the handle counts as at rest [m/s]."""


class Spring(NamedTuple):
    """The desired spring: stiffness [N/m], height of its centre [m], damping beside it [Ns/m]."""

    stiffness: float
    centre: float
    damping: float = 0.0


class Offsets(NamedTuple):
    """Offset from the desired spring while the handle moves [N]: mean of its absolute value, in
    both directions, upward, downward. A direction without motion has NaN."""

    mean: float
    up: float
    down: float


def spring_force(position: np.ndarray, spring: Spring) -> np.ndarray:
    """Return the patient's force on the desired spring [N] at heights `position` [m]."""
    return spring.stiffness * (np.asarray(position) - spring.centre)


def beyond(
    position: np.ndarray, velocity: np.ndarray, force: np.ndarray, spring: Spring
) -> np.ndarray:
    """Return the force [N] beyond that of the desired spring, and of its damper if it has one.

    position [m], velocity [m/s] and force [N] are samples of the same instants.
    """
    damper = spring.damping * np.asarray(velocity)
    return np.asarray(force, float) - spring_force(position, spring) - damper


def offsets(
    position: np.ndarray, velocity: np.ndarray, force: np.ndarray, spring: Spring
) -> Offsets:
    """Evaluate the offset where the speed exceeds `MOTION_THRESHOLD`.

    position [m], velocity [m/s] and force [N] are samples of the same instants, evenly spaced in
    time.
    """
    found = np.abs(beyond(position, velocity, force, spring))
    up, down = found[velocity > MOTION_THRESHOLD], found[velocity < -MOTION_THRESHOLD]
    return Offsets(*map(_mean, (np.concatenate((up, down)), up, down)))


def offset_held(
    position: np.ndarray, velocity: np.ndarray, force: np.ndarray, spring: Spring
) -> float:
    """Return the mean of the absolute offset [N] over all samples, of a hand that holds still."""
    return _mean(np.abs(beyond(position, velocity, force, spring)))


def common_ticks(first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the indices of the ticks that are in both arrays of tick numbers, in order of time.

    Samples with one tick number are simultaneous, also from different devices. The numbers may wrap
    at 2^32 once; a repeated tick counts once.
    """
    origin = int(first[0]) if len(first) else 0
    a, b = ((np.asarray(ticks, np.int64) - origin + 2**31) % 2**32 for ticks in (first, second))
    _, in_first, in_second = np.intersect1d(a, b, return_indices=True)
    return in_first, in_second


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else float("nan")
