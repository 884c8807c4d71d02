# SPDX-License-Identifier: Apache-2.0
"""What arrays of samples show of a movement: its extent, speed, path, and the work at the handle.

Robot and module have mass and friction, so work flows in both directions also without assistance;
the robot's share describes the movement, not the patient's ability.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import find_peaks

from .hand import Point

MOVING_SHARE = 0.1
"""Share of the peak speed above which the hand counts as moving, as in most reports about robots of
this family."""
SHORTEST = 0.1
"""Least duration of a movement [s]."""
SLOWEST = 0.01
"""Least peak speed of a movement [m/s]."""
PEAK_PROMINENCE = 0.05
"""Least prominence of a speed peak, as a share of the peak speed; ours: velocities are noisy."""
INITIAL_SHARE = 0.2
"""Share of the way at which the initial direction is measured; ours."""


def moving(speed: np.ndarray, rate: float) -> slice | None:
    """Return the samples of the movement: from the first to the last above a tenth of the peak.

    speed [m/s], rate [Hz]. None without a movement: shorter than 0.1 s or peak below 0.01 m/s.
    """
    if speed.size == 0:
        return None
    peak = float(speed.max())
    above = np.flatnonzero(speed > MOVING_SHARE * peak)
    if peak < SLOWEST or above.size == 0:
        return None
    found = slice(int(above[0]), int(above[-1]) + 1)
    return found if (found.stop - found.start) / rate >= SHORTEST else None


def ratio(part: float, whole: float) -> float:
    """Return part over whole, NaN if the whole is zero."""
    return part / whole if whole > 0.0 else math.nan


def speed_peaks(speed: np.ndarray) -> float:
    """Return the number of peaks of a movement's speed."""
    padded = np.concatenate(([0.0], speed, [0.0]))  # a profile may begin or end at a peak
    found, _ = find_peaks(padded, prominence=PEAK_PROMINENCE * float(speed.max()))
    return float(len(found))


def time_in_motion(speed: np.ndarray) -> float:
    """Return the share of a movement's samples above a tenth of its peak speed, 0 to 1."""
    return float(np.mean(speed > MOVING_SHARE * float(speed.max())))


def path_error(path: np.ndarray, start: Point, target: Point) -> float:
    """Return the mean distance of a path, shape (samples, 3), from the line start to target [m]."""
    line, _ = _direction(start, target)
    off = path - np.asarray(start)
    across = off - np.outer(off @ line, line)
    return float(np.linalg.norm(across, axis=1).mean())


def path_ratio(path: np.ndarray, start: Point, target: Point) -> float:
    """Return the length of a path over that of the line from start to target."""
    _, length = _direction(start, target)
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()) / length


def direction_error(path: np.ndarray, start: Point, target: Point) -> float:
    """Return the angle between line and direction to the hand after a fifth of the way [rad].

    NaN if the hand did not go that far.
    """
    line, length = _direction(start, target)
    gone = path - path[0]
    distance = np.linalg.norm(gone, axis=1)
    far = np.flatnonzero(distance >= INITIAL_SHARE * length)
    if far.size == 0:
        return math.nan
    cosine = float(gone[far[0]] @ line / distance[far[0]])
    return math.acos(min(1.0, max(-1.0, cosine)))


def _direction(start: Point, target: Point) -> tuple[np.ndarray, float]:
    """Return unit vector and length [m] of a line. Raises ValueError if it is one point."""
    line = np.subtract(target, start)
    length = float(np.linalg.norm(line))
    if length == 0.0:
        raise ValueError("start and target are one point, there is no line")
    return line / length, length


def ellipse(path: np.ndarray) -> tuple[float, float]:
    """Return the smaller and the larger eigenvalue of the covariance of a path's x and y [m^2]."""
    plane = path[:, :2] - path[:, :2].mean(axis=0)
    small, large = np.linalg.eigvalsh(plane.T @ plane / len(plane))
    return max(float(small), 0.0), float(large)


def independence(path: np.ndarray) -> float:
    """Return the small over the large axis of a path's ellipse, 0 to 1.

    1 for a circle walked evenly (dipietro2007).
    """
    small, large = ellipse(path)
    return math.sqrt(small / large) if large > 0.0 else math.nan


def ellipse_area(path: np.ndarray) -> float:
    """Return the area of a path's ellipse [m^2]; pi r^2 for a circle walked evenly."""
    small, large = ellipse(path)
    return 2.0 * math.pi * math.sqrt(small * large)


def hull_area(path: np.ndarray) -> float:
    """Return the area of the convex hull of a path in the plane [m^2]; its columns: x, y, ...

    The hull is Andrew's monotone chain: first below, then above.
    """
    points, hull = sorted({(float(x), float(y)) for x, y, *_ in path}), []
    for way in (points, points[::-1]):
        side: list[tuple[float, float]] = []
        for x, y in way:
            while len(side) > 1 and _turn(side[-2], side[-1], x, y) <= 0.0:
                side.pop()
            side.append((x, y))
        hull += side[:-1]
    ahead = hull[1:] + hull[:1]
    return 0.5 * math.fsum(a * d - b * c for (a, b), (c, d) in zip(hull, ahead, strict=True))


def _turn(one: tuple[float, float], two: tuple[float, float], x: float, y: float) -> float:
    """Return a positive number where the way to x, y turns to the left [m^2]."""
    return (two[0] - one[0]) * (y - one[1]) - (two[1] - one[1]) * (x - one[0])


def hold_deviation(path: np.ndarray, point: Point) -> float:
    """Return the root mean square distance of a path, shape (samples, 3), from a point [m]."""
    return float(np.sqrt(np.mean(np.sum((path - np.asarray(point)) ** 2, axis=1))))


def work_done(force: np.ndarray, velocity: np.ndarray, times: np.ndarray) -> tuple[float, float]:
    """Return the work of the patient on the robot, and of the robot on the patient [J].

    Both positive, by the trapezoidal rule. force: of the patient on the robot [N], velocity [m/s],
    of shape (samples, axes); times [s]. Samples without a valid force (NaN) have zero power.
    """
    power = np.nan_to_num(np.sum(force * velocity, axis=1))
    steps = np.diff(times)
    patient, robot = np.maximum(power, 0.0), np.maximum(-power, 0.0)
    return (
        float(np.sum(0.5 * (patient[1:] + patient[:-1]) * steps)),
        float(np.sum(0.5 * (robot[1:] + robot[:-1]) * steps)),
    )
