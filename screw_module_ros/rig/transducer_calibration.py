# SPDX-License-Identifier: Apache-2.0
"""Calibrations of the simulated six-axis transducer: gauge values and calibration matrix.

The transducer has three beams 120 degrees apart, each with a gauge for the axial force and one for
the tangential force; this geometry determines the gauge values of a wrench. A few per cent of
cross-talk, the same in every run, makes the matrix realistic. The sensor reports the inverse
matrix, rounded to float32 as on the wire: wrench = matrix @ (gauges - bias) / counts per unit.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

NEWTON, NEWTON_METRE = 2, 3
POUND_FORCE, POUND_FORCE_INCH = 1, 1

_RADIUS = 0.05
_AXIAL_GAIN, _TANGENTIAL_GAIN = 130.0, 160.0
_CROSS_TALK = 0.03
_NEWTONS_PER_POUND = 4.4482216152605
_METRES_PER_INCH = 0.0254

ZERO_OFFSETS = (312, -145, 87, -260, 41, 198)
"""Gauge values without load [counts]: the mounting strains every transducer."""


class Calibration(NamedTuple):
    """One calibration as it is stored in the sensor.

    matrix: rows of the 6x6 matrix (fx fy fz tx ty tz), float32 values.
    force_counts, torque_counts: counts per unit. force_unit, torque_unit: ATI unit codes.
    gains: gauge counts per newton and newton metre, rows of gauges 0 to 5.
    """

    matrix: tuple[tuple[float, ...], ...]
    force_counts: int
    torque_counts: int
    force_unit: int
    torque_unit: int
    gains: tuple[tuple[float, ...], ...]

    def gauges(self, wrench: tuple[float, ...]) -> list[float]:
        """Return the gauge counts of a wrench [N, Nm], without zero offsets, not rounded."""
        a, b, c, d, e, f = wrench
        return [g[0] * a + g[1] * b + g[2] * c + g[3] * d + g[4] * e + g[5] * f for g in self.gains]


def _gauge_gains() -> np.ndarray:
    """Return the counts of each gauge per newton and newton metre, cross-talk included."""
    rows = []
    for beam in range(3):
        angle = math.radians(90.0 + 120.0 * beam)
        sine, cosine = math.sin(angle), math.cos(angle)
        lever = 2.0 / (3.0 * _RADIUS)
        axial = (0.0, 0.0, 1.0 / 3.0, lever * sine, -lever * cosine, 0.0)
        tangential = (-2.0 / 3.0 * sine, 2.0 / 3.0 * cosine, 0.0, 0.0, 0.0, lever / 2.0)
        rows += [_AXIAL_GAIN * np.array(axial), _TANGENTIAL_GAIN * np.array(tangential)]
    talk = [[_CROSS_TALK * math.sin(1.7 * i + 2.9 * j + 0.4) for j in range(6)] for i in range(6)]
    return (np.eye(6) + np.array(talk)) @ np.array(rows)


def _calibration(
    force_counts: int,
    torque_counts: int,
    units: tuple[int, int],
    per_unit: tuple[float, float],
) -> Calibration:
    """Return the calibration in units of `per_unit` newtons and newton metres."""
    gains = _gauge_gains()
    scale = [force_counts / per_unit[0]] * 3 + [torque_counts / per_unit[1]] * 3
    matrix = (np.diag(scale) @ np.linalg.inv(gains)).astype(np.float32).astype(float)
    exact = np.linalg.inv(matrix) @ np.diag(scale)
    return Calibration(
        tuple(map(tuple, matrix.tolist())),
        force_counts,
        torque_counts,
        *units,
        tuple(map(tuple, exact.tolist())),
    )


CALIBRATIONS = {
    0: _calibration(144, 5665, (NEWTON, NEWTON_METRE), (1.0, 1.0)),
    1: _calibration(
        640,
        640,
        (POUND_FORCE, POUND_FORCE_INCH),
        (_NEWTONS_PER_POUND, _NEWTONS_PER_POUND * _METRES_PER_INCH),
    ),
}
"""Index -> calibration. 0: the thesis's figures; 1: the same transducer in US units."""
