# SPDX-License-Identifier: Apache-2.0
"""The thesis's form of the friction model over arrays, and its parameters as a vector for fits.

`held_force` is the force of thesis 5.2.5 that maintains a speed, gravity included. A `BranchFit`
has the same degrees of freedom as `FrictionBranch`, with parameters of similar size: Chebyshev
coefficients over the range of heights instead of powers of millimetres, and a speed factor that is
one at `REFERENCE` and continuous at its knee, so that no parameter is redundant.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from numpy.polynomial.chebyshev import chebvander

from ..control.friction import FrictionBranch, FrictionModel

TREND, RIPPLE = 8, 6  # coefficients of the 7th and the 5th order
REFERENCE = 40.0  # speed with a speed factor of one in a fit [mm/s]
NO_FLIP = -1.0  # [mm], as in params/friction_thesis.yaml
PARAMETERS = TREND + RIPPLE + 3
# Lowest and highest: exponent, logarithm of the knee [mm/s], slope [s/mm].
BOUNDS = ((0.0, np.log(1.0), -0.005), (1.0, np.log(20.0), 0.02))


class BranchFit(NamedTuple):
    """One direction. trend, ripple: Chebyshev coefficients of the friction at `REFERENCE` [N], up
    the screw positive; flip_below [mm]; exponent; knee [mm/s]; slope [s/mm]."""

    trend: np.ndarray
    ripple: np.ndarray
    flip_below: float
    exponent: float
    knee: float
    slope: float


def basis(z: np.ndarray, low: float, high: float, coefficients: int) -> np.ndarray:
    """Return the Chebyshev polynomials at heights z [mm], shape (len(z), coefficients)."""
    return chebvander((2.0 * z - low - high) / (high - low), coefficients - 1)


def ripple_phase(z: np.ndarray, lead: float, phase: float, flip_below: float) -> np.ndarray:
    """Return the ripple with amplitude one; its phase is shifted by pi below flip_below [mm]."""
    return np.where(z > flip_below, 1.0, -1.0) * np.sin(2.0 * np.pi / lead * z + phase)


def speed_factor(branch: FrictionBranch, speed: np.ndarray) -> np.ndarray:
    """Return Fv at speeds above zero [mm/s]."""
    speed = np.asarray(speed, float)
    low = branch.low_gain * speed**branch.low_exponent
    return np.where(
        speed <= branch.break_speed_mm_s, low, branch.high_slope * speed + branch.high_offset
    )


def held_force(model: FrictionModel, z: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return the force that maintains a velocity, gravity included [N].

    z [mm], velocity [mm/s], not zero, of one shape. Height and speed are clipped to the model's
    range as in `control.friction`; there is no ramp at low speed, as in the thesis.
    """
    z = np.clip(np.asarray(z, float), model.low_mm, model.high_mm)
    velocity = np.asarray(velocity, float)
    speed = np.clip(np.abs(velocity), 1e-9, model.fastest_mm_s)
    force = np.empty(np.broadcast(z, velocity).shape)
    for branch, mine in ((model.up, velocity > 0.0), (model.down, velocity <= 0.0)):
        place = np.polyval(branch.trend, z) + np.polyval(branch.ripple, z) * ripple_phase(
            z, model.lead_mm, model.phase_rad, branch.flip_below_mm
        )
        held = speed_factor(branch, speed) * (place - model.gravity_N) + model.gravity_N
        force = np.where(mine, held, force)
    return force


def friction_along(model: FrictionModel, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return `control.friction.friction_force` of arrays [N]: position [m], velocity [m/s]."""
    velocity = np.asarray(velocity, float) * 1e3
    sign, speed = np.sign(velocity), np.abs(velocity)
    moving = np.where(velocity > 0.0, 1.0, -1.0) * np.maximum(speed, model.ramp_speed_mm_s)
    force = held_force(model, np.asarray(position, float) * 1e3, moving) - model.gravity_N
    return sign * np.maximum(sign * force, 0.0) * np.minimum(1.0, speed / model.ramp_speed_mm_s)


def fit_factor(exponent: float, knee: float, slope: float, speed: np.ndarray) -> np.ndarray:
    """Return a fit's speed factor at speeds above zero [mm/s]; knee [mm/s], slope [s/mm]."""
    line = 1.0 + slope * (np.maximum(speed, knee) - REFERENCE)
    return line * np.minimum(speed / knee, 1.0) ** exponent


def branch_of(
    fit: BranchFit, speeds: np.ndarray, low: float, high: float, gravity: float
) -> FrictionBranch:
    """Return the fit in the form of controller and thesis, with powers of millimetres.

    Its speed factor has a mean of one over `speeds` [mm/s], so that trend and ripple are those of
    the mean curve, as in the thesis. low, high [mm], gravity [N].
    """
    shape = (fit.exponent, fit.knee, fit.slope)
    mean = float(fit_factor(*shape, np.asarray(speeds)).mean())
    at_knee = float(fit_factor(*shape, np.array([fit.knee]))[0])
    trend = _powers(fit.trend * mean, low, high, TREND)
    trend[-1] += gravity
    return FrictionBranch(
        trend=tuple(map(float, trend)),
        ripple=tuple(map(float, _powers(fit.ripple * mean, low, high, RIPPLE))),
        flip_below_mm=fit.flip_below,
        break_speed_mm_s=fit.knee,
        low_gain=at_knee / mean / fit.knee**fit.exponent,
        low_exponent=fit.exponent,
        high_slope=fit.slope / mean,
        high_offset=(1.0 - fit.slope * REFERENCE) / mean,
    )


def _powers(coefficients: np.ndarray, low: float, high: float, count: int) -> np.ndarray:
    """Return Chebyshev coefficients as those of powers of z [mm], highest first."""
    plain = Chebyshev(coefficients, domain=[low, high]).convert(kind=Polynomial).coef
    return np.pad(plain, (0, count - len(plain)))[::-1].copy()
