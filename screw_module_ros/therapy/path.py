# SPDX-License-Identifier: Apache-2.0
"""Metrics of a path: straightness, initial direction, end point; circles and holding still."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .samples import Point

INITIAL_SHARE = 0.2
"""Share of the way at which the initial direction is measured; ours."""


class PathFigures(NamedTuple):
    """error: mean distance from the line [m]; ratio: path's length over that of the line.

    direction_error: angle between the line and the direction to the hand after a fifth of the way
    [rad], NaN if it did not go that far; reach_error: from the last point to the target [m].
    """

    error: float
    ratio: float
    direction_error: float
    reach_error: float


def path_figures(path: np.ndarray, start: Point, target: Point) -> PathFigures:
    """Return the figures of a path [m], shape (samples, 3), of a reach from start to target [m].

    Raises ValueError if start and target are the same point.
    """
    line = np.subtract(target, start)
    length = float(np.linalg.norm(line))
    if length == 0.0:
        raise ValueError("path_figures: start and target are one point, there is no line")
    line = line / length
    off = path - np.asarray(start)
    across = off - np.outer(off @ line, line)
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    return PathFigures(
        error=float(np.linalg.norm(across, axis=1).mean()),
        ratio=float(steps.sum()) / length,
        direction_error=_direction_error(path, line, length),
        reach_error=float(np.linalg.norm(path[-1] - np.asarray(target))),
    )


def _direction_error(path: np.ndarray, line: np.ndarray, length: float) -> float:
    gone = path - path[0]
    distance = np.linalg.norm(gone, axis=1)
    far = np.flatnonzero(distance >= INITIAL_SHARE * length)
    if far.size == 0:
        return math.nan
    cosine = float(gone[far[0]] @ line / distance[far[0]])
    return math.acos(min(1.0, max(-1.0, cosine)))


class CircleFigures(NamedTuple):
    """independence: small over large axis of the path's ellipse, 0 to 1; size: its area [m^2].

    From the eigenvalues l of the covariance of x and y: sqrt(lmin/lmax) and 2 pi sqrt(lmin lmax);
    for a circle of radius r walked evenly 1 and pi r^2 (Dipietro et al., J. Neurophysiol. 98:757,
    2007).
    """

    independence: float
    size: float


def circle_figures(path: np.ndarray) -> CircleFigures:
    """Return the figures of a path [m], shape (samples, 3), of circles in the plane."""
    plane = path[:, :2] - path[:, :2].mean(axis=0)
    small, large = np.linalg.eigvalsh(plane.T @ plane / len(plane))
    small, large = max(float(small), 0.0), float(large)
    return CircleFigures(
        independence=math.sqrt(small / large) if large > 0.0 else math.nan,
        size=2.0 * math.pi * math.sqrt(small * large),
    )


def hold_deviation(path: np.ndarray, point: Point) -> float:
    """Return the root mean square distance of a path [m], shape (samples, 3), from a point [m]."""
    return float(np.sqrt(np.mean(np.sum((path - np.asarray(point)) ** 2, axis=1))))
