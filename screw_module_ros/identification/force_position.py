# SPDX-License-Identifier: Apache-2.0
"""How far the handle is from the spring it should feel like (thesis 6.1, 6.4; figs 6-1 to 6-13).

A perfect impedance controller shows the patient a spring: pushing the handle to the height z takes
K (z - z0), whichever way it moves. What is measured beyond that is the offset: friction, the
inertia of the screw, and what compensation leaves of them. All forces are those of the patient on
the robot, up positive.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

MOTION_THRESHOLD = 0.020
"""Slower than this the handle counts as at rest [m/s] (the thesis's limit in 5.3)."""


class Spring(NamedTuple):
    """The spring asked for: stiffness [N/m] about the height centre [m]."""

    stiffness: float
    centre: float


class Offsets(NamedTuple):
    """Offset from the desired spring while the handle moves.

    mean: mean of its absolute value, both ways [N]; up, down: the same, one way each [N].
    bias_up, bias_down: mean with its sign [N], positive where the patient must push up more.
    samples_up, samples_down: how many samples that is. A way that never moved is NaN.
    """

    mean: float
    up: float
    down: float
    bias_up: float
    bias_down: float
    samples_up: int
    samples_down: int


def spring_force(position: np.ndarray, spring: Spring) -> np.ndarray:
    """Return the patient's force on the desired spring [N] at heights `position` [m]."""
    return spring.stiffness * (np.asarray(position) - spring.centre)


def offset(position: np.ndarray, force: np.ndarray, spring: Spring) -> np.ndarray:
    """Return measured minus desired force [N]; position [m] and force [N], one per sample."""
    return np.asarray(force) - spring_force(position, spring)


def offsets(
    position: np.ndarray,
    velocity: np.ndarray,
    force: np.ndarray,
    spring: Spring,
    threshold: float = MOTION_THRESHOLD,
) -> Offsets:
    """Evaluate the offset where the speed exceeds `threshold` [m/s].

    position [m], velocity [m/s] and force [N] are samples of the same instants, evenly spaced in
    time. Raises ValueError when their lengths differ, when a value is not finite, or when the
    threshold is not positive.
    """
    position, velocity, force = (np.asarray(a, float) for a in (position, velocity, force))
    if not position.shape == velocity.shape == force.shape or position.ndim != 1:
        raise ValueError(
            f"position {position.shape}, velocity {velocity.shape} and force {force.shape} must be "
            "arrays of one length"
        )
    if not threshold > 0.0:
        raise ValueError(f"threshold = {threshold} m/s: a positive speed is wanted")
    for name, values in (("position", position), ("velocity", velocity), ("force", force)):
        if not np.isfinite(values).all():
            raise ValueError(f"{name} holds values that are not finite")
    beyond = offset(position, force, spring)
    up, down = beyond[velocity > threshold], beyond[velocity < -threshold]
    return Offsets(
        mean=_mean(np.abs(np.concatenate((up, down)))),
        up=_mean(np.abs(up)),
        down=_mean(np.abs(down)),
        bias_up=_mean(up),
        bias_down=_mean(down),
        samples_up=len(up),
        samples_down=len(down),
    )


def common_ticks(first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the indices of the ticks that are in both arrays of tick numbers, in order of time.

    Two samples of one tick were acquired at one instant, whatever device they come from. The
    numbers may pass 2^32 once; a tick that is there twice counts once.
    """
    origin = int(first[0]) if len(first) else 0
    counted = [(np.asarray(a, np.int64) - origin + 2**31) % 2**32 for a in (first, second)]
    _, in_first, in_second = np.intersect1d(*counted, return_indices=True)
    return in_first, in_second


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else float("nan")
