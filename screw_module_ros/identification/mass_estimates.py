# SPDX-License-Identifier: Apache-2.0
"""Mass from back-driven motion, by the thesis's ratio (5.3) and by regression (ours).

Force of the hand minus modelled friction and weight should equal mass times acceleration. The
thesis shifts one curve against the other for the least spread of their ratio, and divides sample
by sample. Ours is a robust regression over all samples for the mass and the errors of the friction
model, without division and shift. The errors are a viscous part, a Coulomb part, a constant, and a
part proportional to the load: friction depends on the load (5.2.4), and the hand pushes harder here
than the stage.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import oaconvolve

from .friction_bins import optimal_lowpass, zero_phase

CUTOFF_HZ, STOP_HZ = 30.0, 50.0  # thesis 5.3.2
_CENTRE = np.array([0.5, 0.0, -0.5])  # (z[k+1] - z[k-1]) / 2 as a convolution
_LEAST_S = 1.0  # of a record, several periods and the filter's ends
_EDGE_S = 0.25  # at each end, where the filter uses mirrored samples


class Motion(NamedTuple):
    """A back-driven record: time [s], position [m], velocity [m/s], acceleration [m/s^2], force of
    the hand [N] and the same filtered like the acceleration; arrays of one length."""

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    force: np.ndarray
    smooth: np.ndarray


Record = tuple[Motion, np.ndarray]
"""A motion and the model's friction and weight along it [N]."""


class Ratio(NamedTuple):
    """The thesis's result of one record: shift of the acceleration, positive = delayed [s]; mass at
    each sample [kg], NaN for excluded samples."""

    shift: float
    mass: np.ndarray


class Regression(NamedTuple):
    """mass [kg]; viscous [N s/m], coulomb [N], constant [N], load (share of the force beyond that
    of the maps): errors of the friction model; rms of the residual [N]."""

    mass: float
    viscous: float
    coulomb: float
    constant: float
    load: float
    rms: float


def motion(time: np.ndarray, position: np.ndarray, force: np.ndarray) -> Motion:
    """Differentiate a record as in 5.3.2: centre difference, low-pass, and both again.

    time [s], evenly spaced, position [m], force [N]. The result lacks the ends, where the filter
    has only half of its samples. Raises ValueError for a record that is too short.
    """
    period = (time[-1] - time[0]) / (len(time) - 1)
    taps = optimal_lowpass(CUTOFF_HZ, STOP_HZ, 1.0 / period)
    if len(time) * period < _LEAST_S:
        raise ValueError(
            f"a record of {len(time) * period:.2g} s is too short: {_LEAST_S:g} s are needed"
        )
    velocity = zero_phase(_centre_difference(position, period), taps)
    acceleration = zero_phase(_centre_difference(velocity, period), taps)
    smooth = zero_phase(zero_phase(force, taps), taps)
    edge = round(_EDGE_S / period)
    record = Motion(time, position, velocity, acceleration, force, smooth)
    return Motion(*(values[edge:-edge] for values in record))


def _centre_difference(values: np.ndarray, period: float) -> np.ndarray:
    inner = oaconvolve(values, _CENTRE / period, mode="valid")
    return np.concatenate((inner[:1], inner, inner[-1:]))


def usable(
    velocity: np.ndarray, acceleration: np.ndarray, least_speed: float, least_acceleration: float
) -> np.ndarray:
    """Return the mask of samples fast [m/s] and accelerated [m/s^2] enough (5.3.2)."""
    return (np.abs(velocity) >= least_speed) & (np.abs(acceleration) >= least_acceleration)


def ratio(
    record: Motion,
    inertial: np.ndarray,
    least_speed: float,
    least_acceleration: float,
    widest_shift: float,
) -> Ratio:
    """Return the thesis's mass: inertial force over acceleration, best shift of the two.

    inertial: force minus friction and weight [N]. The shift, at most widest_shift [s] in either
    direction, gives the ratio's least standard deviation; NaN without usable samples.
    """
    period = (record.time[-1] - record.time[0]) / (len(record.time) - 1)
    widest = round(widest_shift / period)
    middle = slice(widest, len(inertial) - widest)
    best, least = Ratio(float("nan"), np.full(len(inertial), np.nan)), np.inf
    for shift in range(-widest, widest + 1):
        moved = record.acceleration[widest - shift : len(inertial) - widest - shift]
        use = usable(record.velocity[middle], moved, least_speed, least_acceleration)
        if not use.any():
            continue
        found = inertial[middle][use] / moved[use]
        if found.std() < least:
            least = float(found.std())
            mass = np.full(len(inertial), np.nan)
            mass[middle][use] = found
            best = Ratio(shift * period, mass)
    return best


def regression(
    records: list[Record], least_speed: float, every: int, loaded: bool = True
) -> Regression:
    """Fit F - F_f = M a + b v + c sign(v) + d + l (|F| - |F_f|) sign(v) over all records.

    F is the filtered force. least_speed [m/s]: slower samples do not count; every: use each n-th
    sample, as neighbours are correlated; loaded: False omits the last term, l = 0.
    Raises ValueError without samples.
    """
    rows, wanted = [], []
    for record, friction in records:
        use = np.flatnonzero(np.abs(record.velocity) >= least_speed)[::every]
        v = record.velocity[use]
        force, held = record.smooth[use], friction[use]
        load = (np.abs(force) - np.abs(held)) * np.sign(v) * loaded
        rows.append((record.acceleration[use], v, np.sign(v), np.ones_like(v), load))
        wanted.append(force - held)
    terms, force = np.concatenate(rows, axis=1).T, np.concatenate(wanted)
    if len(force) < 10 * terms.shape[1]:
        raise ValueError("too few samples of the motion are fast enough to determine a mass")
    start, *_ = np.linalg.lstsq(terms, force, rcond=None)
    found = least_squares(
        lambda x: terms @ x - force, start, jac=lambda x: terms.copy(), loss="soft_l1"
    )
    left = terms @ found.x - force
    return Regression(*map(float, found.x), float(np.sqrt(np.mean(left**2))))


def jackknife(records: list[Record], least_speed: float, every: int) -> float:
    """Return the standard error of the mass [kg] by a jackknife over the records.

    Samples of one record share the friction model's errors, so they are not independent.
    NaN with fewer than three records.
    """
    n = len(records)
    if n < 3:
        return float("nan")
    masses = [
        regression(records[:out] + records[out + 1 :], least_speed, every).mass for out in range(n)
    ]
    return float(np.sqrt((n - 1) * np.var(masses)))
