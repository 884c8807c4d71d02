# SPDX-License-Identifier: Apache-2.0
"""Fit of the amplifier's linearization to measured command and torque (thesis 4.1.1, fig 4-3)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from ..control.linearization import SMALLEST_JOINT, Line, Linearization, torque_command
from ..settings import validated

_GRID = np.linspace(0.01, 0.06, 11)  # initial values of the joints [Nm]
_REACH = (SMALLEST_JOINT, 0.5)  # smallest joint [Nm], largest as a share of the torque reached


class Pieces(NamedTuple):
    """The fit: the map, and standard errors of (lower value and slope, upper value and slope at
    the joints) and of the two joints; residual: standard deviation of the command [Nm]."""

    linearization: Linearization
    errors: np.ndarray
    joint_errors: np.ndarray
    residual: float


def fit_pieces(torque: np.ndarray, command: np.ndarray) -> Pieces:
    """Fit line, cubic, line of command [Nm] over torque [Nm], continuous, by least squares.

    For fixed joints the problem is linear: values and slopes of both lines at their joints, and the
    cubic as the chord between them plus (T - low)(T - high)(p + q T). An outer optimisation finds
    the joints. Raises ValueError if the torques do not determine the fit or the command does not
    increase.
    """
    reach = min(-float(torque.min()), float(torque.max()))
    if reach < 3.0 * _GRID[0]:
        raise ValueError(
            f"torque reached {torque.min():.3g} to {torque.max():.3g} Nm: too little on one side "
            "for a fit in three pieces; is the rotor locked and the drive enabled?"
        )

    def left(joints: np.ndarray) -> np.ndarray:
        return _linear_part(joints, torque, command)[1]

    grid = [np.array([-joint, joint]) for joint in _GRID if joint < _REACH[1] * reach]
    start = min(grid, key=lambda joints: float(np.sum(left(joints) ** 2)))
    low, high = _REACH[0], _REACH[1] * reach
    found = least_squares(
        left, start, bounds=([-high, low], [-low, high]), x_scale=0.01, diff_step=1e-3
    )
    numbers, residual, basis = _linear_part(found.x, torque, command)
    spread = float(np.std(residual))
    return Pieces(
        validated(_map(found.x, numbers)),
        spread * np.sqrt(np.diag(np.linalg.inv(basis.T @ basis)))[:4],
        spread * np.sqrt(np.diag(np.linalg.pinv(found.jac.T @ found.jac))),
        spread,
    )


def _linear_part(
    joints: np.ndarray, torque: np.ndarray, command: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the six coefficients for fixed joints, the residual and the basis."""
    low, high = joints
    share = np.clip((torque - low) / (high - low), 0.0, 1.0)
    inside = (torque > low) & (torque < high)
    bow = np.where(inside, (torque - low) * (torque - high), 0.0)
    basis = np.column_stack(
        [
            1.0 - share,
            np.minimum(torque - low, 0.0),
            share,
            np.maximum(torque - high, 0.0),
            bow,
            bow * torque,
        ]
    )
    numbers = np.linalg.lstsq(basis, command, rcond=None)[0]
    return numbers, basis @ numbers - command, basis


def desired_torque(linearization: Linearization | None, command: np.ndarray) -> np.ndarray:
    """Return the desired torque [Nm] that the linearization maps to `command` [Nm]."""
    if linearization is None:
        return command
    far = 2.0 + float(np.abs(command).max())
    torques = np.concatenate([[-far], np.linspace(*linearization.joints_Nm, 2001), [far]])
    return np.interp(command, commands(linearization, torques), torques)


def commands(linearization: Linearization, torques: np.ndarray) -> np.ndarray:
    """Return the commands [Nm] for torques [Nm]."""
    return np.array([torque_command(linearization, float(torque)) for torque in torques])


def _map(joints: np.ndarray, numbers: np.ndarray) -> Linearization:
    low, high = map(float, joints)
    lower, lower_slope, upper, upper_slope, p, q = map(float, numbers)
    chord = (upper - lower) / (high - low)
    cubic = np.polyadd(
        np.polymul(np.poly([low, high]), [q, p]), [chord, lower - chord * low]
    )
    return Linearization(
        (low, high),
        Line(lower_slope, lower - lower_slope * low),
        tuple(map(float, cubic)),
        Line(upper_slope, upper - upper_slope * high),
    )
