# SPDX-License-Identifier: Apache-2.0
"""What a hand feels beside the impedance asked for: offset in motion, error over all samples.

With a perfect impedance controller the patient feels a spring: the force at height z is
K (z - z0), in both directions of motion. The offset is the measured force minus that of the spring:
friction, the inertia of the screw, and the residual of their compensation (thesis 6.1, 6.4). The
error is judged over all samples, with standstill and reversals (ours). All forces are those of the
patient on the robot, up positive.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import signal

MOTION_THRESHOLD = 0.020
"""Below this speed the handle counts as at rest [m/s] (the thesis's limit in 5.3)."""
RAPID = 30.0  # [Hz] above it: chatter
SWING = 3.0  # [Hz] above it, with a hand at rest: an oscillation
SHAKING = 1.5  # [N] rms over `WINDOW` of the force above SWING: unacceptable oscillation
WINDOW = 0.1  # [s]
LAST = 1.0  # [s] at the end of a trial, when the handle should be at rest


class Spring(NamedTuple):
    """The commanded spring: stiffness [N/m], height of its centre [m]."""

    stiffness: float
    centre: float


class Offsets(NamedTuple):
    """Offset from the desired spring while the handle moves.

    mean: mean of its absolute value, both directions [N]; up, down: the same per direction [N].
    bias_up, bias_down: mean with sign [N], positive if the patient must push up more.
    samples_up, samples_down: number of samples. A direction without motion has NaN.
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

    Samples with one tick number are simultaneous, also from different devices. The numbers may wrap
    at 2^32 once; a repeated tick counts once.
    """
    origin = int(first[0]) if len(first) else 0
    counted = [(np.asarray(a, np.int64) - origin + 2**31) % 2**32 for a in (first, second)]
    _, in_first, in_second = np.intersect1d(*counted, return_indices=True)
    return in_first, in_second


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else float("nan")


class ErrorOf(NamedTuple):
    """Force error of one trial.

    mean: of the absolute value, rms, p99: 99th percentile of the absolute value, rapid: rms above
    `RAPID` [N]; swing: rms above `SWING` in the last second [N]; travel: of the handle in the last
    second [m]; share: remaining share of the force gain at the end, 0 to 1; shaking: the longest
    time for which the rms above `SWING` over a window stays above `SHAKING` [s].
    """

    mean: float
    rms: float
    p99: float
    rapid: float
    swing: float
    travel: float
    share: float
    shaking: float


def judged(
    period: float,
    position: np.ndarray,
    velocity: np.ndarray,
    force: np.ndarray,
    share: np.ndarray,
    stiffness: float,
    damping: float,
    first: int = 0,
) -> ErrorOf:
    """Return the error of samples `period` [s] apart, counted from the sample `first`.

    position: of the handle from the spring's centre [m], velocity [m/s], force: of the patient on
    the robot [N], share: of the force gain; stiffness [N/m], damping [Ns/m]: commanded. Raises
    ValueError for fewer samples than one second has.
    """
    last = round(LAST / period)
    if len(force) - first < last:
        raise ValueError(f"{len(force) - first} samples are judged: at least {last} are wanted")
    error = force - stiffness * position - damping * velocity
    kept = error[first:]
    return ErrorOf(
        mean=float(np.abs(kept).mean()),
        rms=_rms(kept),
        p99=float(np.percentile(np.abs(kept), 99.0)),
        rapid=_rms(_above(RAPID, error, period)[first:]),
        swing=_rms(_above(SWING, error, period)[-last:]),
        travel=float(np.ptp(position[-last:])),
        share=float(share[-1]),
        shaking=period * _longest(_above(SWING, error, period)[first:], round(WINDOW / period)),
    )


def _above(corner: float, values: np.ndarray, period: float) -> np.ndarray:
    sections = signal.butter(4, corner, "high", fs=1.0 / period, output="sos")
    return signal.sosfiltfilt(sections, values)


def _longest(swing: np.ndarray, window: int) -> int:
    """Return the largest number of successive samples with a windowed rms above `SHAKING`."""
    sums = np.cumsum(np.concatenate(([0.0], swing**2)))
    over = (sums[window:] - sums[:-window]) / window > SHAKING**2
    edges = np.flatnonzero(np.diff(np.concatenate(([0], over.astype(int), [0]))))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
