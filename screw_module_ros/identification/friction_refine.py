# SPDX-License-Identifier: Apache-2.0
"""From maps of friction to the parameters of the thesis's form (thesis 5.2.5).

First as in the thesis: the mean over the speeds gives trend and ripple, then the mean over the
heights gives the speed factor. Phase and flip of the ripple are searched on a grid, where the rest
is linear. Then everything is refined together on all cells of both directions.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import curve_fit, least_squares

from ..geometry import SCREW
from .friction_bins import BIN_MM
from .friction_form import (
    BOUNDS,
    NO_FLIP,
    PARAMETERS,
    RIPPLE,
    TREND,
    BranchFit,
    Grid,
    basis,
    fit_factor,
    fit_friction,
    packed,
    ripple_phase,
    unpacked,
)

_PHASES = np.arange(36) * (np.pi / 36.0)  # beyond pi the amplitude changes its sign
_FLIPS = np.arange(20.0, 336.0, 2.5)  # [mm]
_FIRST = (0.15, np.log(2.5), 0.003)  # exponent, knee and slope near the thesis's


class Shape(NamedTuple):
    """Result of the search over the mean curves: phase [rad] and flips, up and down [mm]."""

    phase: float
    flips: tuple[float, float]


class Fitted(NamedTuple):
    """Refined fit. low, high: range of heights that was measured [mm]; errors: standard errors of
    the optimiser's numbers, up, down, phase; cost: half the sum of squared residuals [N^2]."""

    branches: tuple[BranchFit, BranchFit]
    phase: float
    low: float
    high: float
    errors: np.ndarray
    cost: float


class _Maps(NamedTuple):
    """z: bins [mm]; speeds [mm/s]; up, down [N]; low, high: edges of what was measured [mm]."""

    z: np.ndarray
    speeds: np.ndarray
    up: np.ndarray
    down: np.ndarray
    low: float
    high: float


def fit_maps(
    z: np.ndarray, speeds: np.ndarray, up: np.ndarray, down: np.ndarray, flip_gain: float
) -> Fitted:
    """Fit both directions together.

    z: bins [mm]; speeds [mm/s]; up, down: friction [N], up the screw positive, (speeds, bins), NaN
    where nothing was measured. Raises ValueError when there is too little to fit.
    """
    for way, force in zip(("up", "down"), (up, down), strict=True):
        if np.isfinite(force).sum() < 5 * PARAMETERS or np.isfinite(force).any(axis=1).sum() < 4:
            raise ValueError(f"the map {way} has too few cells for the model's form: measure more")
    there = z[np.isfinite(up).any(axis=0) | np.isfinite(down).any(axis=0)]
    edge = 0.5 * BIN_MM
    maps = _Maps(z, speeds, up, down, float(there.min()) - edge, float(there.max()) + edge)
    means = [_mean_curve(force) for force in (up, down)]
    shape = _shape(maps, means, flip_gain)
    first = [
        _staged(maps, force, mean, shape.phase, flip)
        for force, mean, flip in zip((up, down), means, shape.flips, strict=True)
    ]
    best = _refined(maps, first, shape)
    for way, flip in enumerate(shape.flips):
        for near in (flip - BIN_MM, flip + BIN_MM) if flip != NO_FLIP else ():
            flips = tuple(near if number == way else f for number, f in enumerate(shape.flips))
            other = _refined(maps, first, shape._replace(flips=flips))
            best = min(best, other, key=lambda fitted: fitted.cost)
    return best


def _mean(values: np.ndarray, axis: int) -> np.ndarray:
    """Return the mean of what is not NaN, NaN where nothing is."""
    count = np.isfinite(values).sum(axis=axis)
    return np.where(count > 0, np.nansum(values, axis=axis) / np.maximum(count, 1), np.nan)


def _mean_curve(force: np.ndarray) -> np.ndarray:
    """Return the mean over the speeds, levelled so that a speed missing at an end is not missed."""
    level = _mean(force, 1)
    return _mean(force / level[:, None], 0) * float(np.nanmean(level))


def _shape(maps: _Maps, means: list[np.ndarray], flip_gain: float) -> Shape:
    """Find phase and flips on the mean curves: linear fits over a grid of both."""
    errors = np.array(
        [
            [[_misfit(maps, mean, phase, flip) for flip in (NO_FLIP, *_FLIPS)] for phase in _PHASES]
            for mean in means
        ]
    )  # (direction, phase, flip)
    plain = errors[:, :, 0]
    best = errors[:, :, 1:].min(axis=2)
    worth = best.min(axis=1) < (1.0 - flip_gain) * plain.min(axis=1)
    total = np.where(worth[:, None], best, plain).sum(axis=0)
    at = int(np.argmin(total))
    flips = [
        float(_FLIPS[np.argmin(errors[way, at, 1:])]) if worth[way] else NO_FLIP for way in (0, 1)
    ]
    return Shape(float(_PHASES[at]), (flips[0], flips[1]))


def _terms(maps: _Maps, there: np.ndarray, phase: float, flip: float) -> np.ndarray:
    z, low, high = maps.z[there], maps.low, maps.high
    ripple = ripple_phase(z, SCREW.lead * 1e3, phase, flip)
    return np.hstack(
        (basis(z, low, high, TREND), basis(z, low, high, RIPPLE) * ripple[:, None])
    )


def _misfit(maps: _Maps, mean: np.ndarray, phase: float, flip: float) -> float:
    there = np.isfinite(mean)
    terms = _terms(maps, there, phase, flip)
    orthogonal, _ = np.linalg.qr(terms)
    left = mean[there] - orthogonal @ (orthogonal.T @ mean[there])
    return float(left @ left)


def _staged(
    maps: _Maps, force: np.ndarray, mean: np.ndarray, phase: float, flip: float
) -> BranchFit:
    """Return the thesis's way: place from the mean curve, then the speed factor."""
    there = np.isfinite(mean)
    place, *_ = np.linalg.lstsq(_terms(maps, there, phase, flip), mean[there], rcond=None)
    factor = _mean(force, 1) / float(np.nanmean(mean))
    known = np.isfinite(factor)

    def form(speed, scale, *rest):
        return scale * fit_factor(unpacked(np.concatenate((place, rest)), flip), speed)

    low, high = ((least, *values) for least, values in zip((0.1, 10.0), BOUNDS, strict=True))
    values, _ = curve_fit(
        form, maps.speeds[known], factor[known], p0=(1.0, *_FIRST), bounds=(low, high)
    )
    return unpacked(np.concatenate((place * values[0], values[1:])), flip)


def _refined(maps: _Maps, first: list[BranchFit], shape: Shape) -> Fitted:
    """Refine all parameters of both directions and the phase on all cells."""
    forces = (maps.up, maps.down)
    height, speed = np.meshgrid(maps.z, maps.speeds)
    cells = [np.isfinite(force) for force in forces]
    grids = [Grid(height[c], speed[c], maps.low, maps.high, SCREW.lead * 1e3) for c in cells]
    wanted = np.concatenate([force[c] for force, c in zip(forces, cells, strict=True)])

    def branches(x):
        return [
            unpacked(part, flip)
            for part, flip in zip(np.split(x[:-1], 2), shape.flips, strict=True)
        ]

    def beyond(x):
        parts = [fit_friction(b, g, x[-1]) for b, g in zip(branches(x), grids, strict=True)]
        return np.concatenate(parts) - wanted

    free = np.full(TREND + RIPPLE, np.inf)
    low = np.concatenate((-free, BOUNDS[0], -free, BOUNDS[0], (-np.inf,)))
    high = np.concatenate((free, BOUNDS[1], free, BOUNDS[1], (np.inf,)))
    start = np.concatenate((*(packed(fit) for fit in first), (shape.phase,)))
    start = np.clip(start, low + 1e-6, high - 1e-6)
    found = least_squares(beyond, start, bounds=(low, high), x_scale="jac")
    spare = max(len(wanted) - len(start), 1)
    inverse = np.linalg.pinv(found.jac.T @ found.jac)
    errors = np.sqrt(np.diag(inverse) * 2.0 * found.cost / spare)
    up, down = branches(found.x)
    return Fitted(
        (up, down), float(found.x[-1]), maps.low, maps.high, errors, float(found.cost)
    )
