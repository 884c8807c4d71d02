# SPDX-License-Identifier: Apache-2.0
"""Fits the parameters of the thesis's form to maps of friction (thesis 5.2.5).

A grid search finds phase and flip of the ripple on the means over the speeds, as in the thesis.
Then all cells of both directions are fitted together. Trend and ripple are linear parameters and
are solved for exactly in each step; the optimiser varies only the phase and the speed factors
(variable projection: Golub and Pereyra 1973).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from ..geometry import SCREW
from .friction_bins import BIN_MM
from .friction_form import (
    BOUNDS,
    NO_FLIP,
    PARAMETERS,
    RIPPLE,
    TREND,
    BranchFit,
    basis,
    fit_factor,
    ripple_phase,
)

_LEAD = SCREW.lead * 1e3  # [mm]
_PHASES = np.arange(36) * (np.pi / 36.0)  # phases beyond pi equal a negative amplitude
_FLIPS = np.arange(20.0, 336.0, BIN_MM)  # [mm]
_FEWEST_BINS = 30  # four turns of the screw; with 20 the fit is off by 20 N between the bins
_FIRST = (0.15, np.log(2.5), 0.003)  # initial exponent, knee and slope, near the thesis's


class Fitted(NamedTuple):
    """branches: up and down; phase and its standard error [rad]; low, high: range of heights that
    was measured in both directions [mm]; cost: half the sum of squared residuals [N^2]."""

    branches: tuple[BranchFit, BranchFit]
    phase: float
    phase_error: float
    low: float
    high: float
    cost: float


class _Cells(NamedTuple):
    """One direction's measured cells: height [mm], speed [mm/s], friction [N]; trend, ripple: the
    polynomials there, shape (cells, coefficients)."""

    z: np.ndarray
    speed: np.ndarray
    force: np.ndarray
    trend: np.ndarray
    ripple: np.ndarray


def fit_maps(
    z: np.ndarray, speeds: np.ndarray, up: np.ndarray, down: np.ndarray, flip_gain: float
) -> Fitted:
    """Fit both directions together.

    z: bins [mm]; speeds [mm/s]; up, down: friction [N], up the screw positive, (speeds, bins), NaN
    for cells not measured; flip_gain: least relative reduction of the mean curve's squared error
    for which a flip is used. Raises ValueError for too few cells.
    """
    low, high = _common_range(z, up, down)
    inside = (z > low) & (z < high)
    z, up, down = z[inside], up[:, inside], down[:, inside]
    for direction, force in zip(("up", "down"), (up, down), strict=True):
        if np.isfinite(force).sum() < 5 * PARAMETERS or np.isfinite(force).any(axis=1).sum() < 4:
            raise ValueError(
                f"the map {direction} has too few cells for the model's form: measure more"
            )
    means = [_cells(z, np.zeros(1), _mean_curve(force)[None, :], low, high) for force in (up, down)]
    phase, flips = _shape(means, flip_gain)
    cells = [_cells(z, speeds, force, low, high) for force in (up, down)]
    best, found = flips, _refined(cells, flips, phase)
    for direction, flip in enumerate(flips):
        for near in (flip - BIN_MM, flip + BIN_MM) if flip != NO_FLIP else ():
            other = (near, best[1]) if direction == 0 else (best[0], near)
            tried = _refined(cells, other, phase)
            if tried.cost < found.cost:
                best, found = other, tried
    return _fitted(cells, best, found, low, high)


def _common_range(z: np.ndarray, up: np.ndarray, down: np.ndarray) -> tuple[float, float]:
    """Return the range of heights that was measured in both directions [mm].

    Outside its bins, and in a wide gap between them, a polynomial of 7th order can be anything.
    Raises ValueError for too few bins or a gap of more than a turn of the screw.
    """
    there = [z[np.isfinite(force).any(axis=0)] for force in (up, down)]
    first, last = max(bins[0] for bins in there), min(bins[-1] for bins in there)
    for direction, bins in zip(("up", "down"), there, strict=True):
        bins = bins[(bins >= first) & (bins <= last)]
        if len(bins) < _FEWEST_BINS or np.diff(bins).max() > _LEAD:
            raise ValueError(
                f"the map {direction} does not determine the model's form: {len(bins)} bins in the "
                f"range of both maps, {_FEWEST_BINS} are needed, without a gap of more than "
                f"{_LEAD:g} mm: measure more"
            )
    return float(first) - 0.5 * BIN_MM, float(last) + 0.5 * BIN_MM


def _cells(
    z: np.ndarray, speeds: np.ndarray, force: np.ndarray, low: float, high: float
) -> _Cells:
    there = np.isfinite(force)
    height, speed = (grid[there] for grid in np.meshgrid(z, speeds))
    return _Cells(
        height,
        speed,
        force[there],
        basis(height, low, high, TREND),
        basis(height, low, high, RIPPLE),
    )


def _mean_curve(force: np.ndarray) -> np.ndarray:
    """Return the mean over the speeds, normalised so that missing cells have no effect."""
    level = _mean(force, 1)
    return _mean(force / level[:, None], 0) * float(np.nanmean(level))


def _mean(values: np.ndarray, axis: int) -> np.ndarray:
    """Return the mean over the finite values, NaN without any."""
    count = np.isfinite(values).sum(axis=axis)
    return np.where(count > 0, np.nansum(values, axis=axis) / np.maximum(count, 1), np.nan)


def _shape(means: list[_Cells], flip_gain: float) -> tuple[float, tuple[float, float]]:
    """Find phase [rad] and flips [mm] on the mean curves: linear fits over a grid of both."""
    candidates = (NO_FLIP, *_FLIPS)
    errors = np.array(
        [[[_misfit(m, phase, flip) for flip in candidates] for phase in _PHASES] for m in means]
    )  # (direction, phase, flip)
    plain, turned = errors[:, :, 0], errors[:, :, 1:].min(axis=2)
    worth = turned.min(axis=1) < (1.0 - flip_gain) * plain.min(axis=1)
    at = int(np.argmin(np.where(worth[:, None], turned, plain).sum(axis=0)))
    up, down = (
        float(_FLIPS[np.argmin(errors[direction, at, 1:])]) if worth[direction] else NO_FLIP
        for direction in (0, 1)
    )
    return float(_PHASES[at]), (up, down)


def _misfit(mean: _Cells, phase: float, flip: float) -> float:
    left = _place(mean, np.ones(1), phase, flip)[1]
    return float(left @ left)


def _place(
    cells: _Cells, factor: np.ndarray, phase: float, flip: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the best coefficients of trend and ripple for a speed factor, and the residual [N]."""
    ripple = ripple_phase(cells.z, _LEAD, phase, flip)
    terms = np.hstack((cells.trend, cells.ripple * ripple[:, None]))
    terms *= factor[:, None]
    # Chebyshev polynomials are nearly orthogonal: the normal equations are well conditioned.
    coefficients = np.linalg.solve(terms.T @ terms, terms.T @ cells.force)
    return coefficients, terms @ coefficients - cells.force


def _factor(cells: _Cells, numbers: np.ndarray) -> np.ndarray:
    exponent, log_knee, slope = numbers
    return fit_factor(exponent, np.exp(log_knee), slope, cells.speed)


def _refined(
    cells: list[_Cells], flips: tuple[float, float], phase: float
) -> OptimizeResult:
    """Refine the phase and both speed factors, x = (phase, 3 numbers up, 3 down)."""

    def beyond(x: np.ndarray) -> np.ndarray:
        return np.concatenate(
            [
                _place(c, _factor(c, numbers), x[0], flip)[1]
                for c, numbers, flip in zip(cells, np.split(x[1:], 2), flips, strict=True)
            ]
        )

    edges = zip((-9.0, 9.0), BOUNDS, strict=True)
    low, high = ((edge, *numbers, *numbers) for edge, numbers in edges)
    start = np.array((phase, *_FIRST, *_FIRST))
    return least_squares(beyond, start, bounds=(low, high), x_scale="jac")


def _fitted(
    cells: list[_Cells], flips: tuple[float, float], found: OptimizeResult, low: float, high: float
) -> Fitted:
    """Return the fit with the upward ripple's amplitude positive on average.

    A ripple shifted by half a cycle with negated amplitude is the same ripple.
    """
    phase = float(found.x[0])
    branches = []
    for c, numbers, flip in zip(cells, np.split(found.x[1:], 2), flips, strict=True):
        place, _ = _place(c, _factor(c, numbers), phase, flip)
        exponent, log_knee, slope = map(float, numbers)
        branches.append(
            BranchFit(place[:TREND], place[TREND:], flip, exponent, float(np.exp(log_knee)), slope)
        )
    up, down = branches
    if float((cells[0].ripple @ up.ripple).mean()) < 0.0:
        up, down = (branch._replace(ripple=-branch.ripple) for branch in branches)
        phase += np.pi
    spare = max(sum(len(c.force) for c in cells) - 2 * PARAMETERS - 1, 1)
    covariance = np.linalg.pinv(found.jac.T @ found.jac) * 2.0 * found.cost / spare
    return Fitted((up, down), phase, float(np.sqrt(covariance[0, 0])), low, high, float(found.cost))
