# SPDX-License-Identifier: Apache-2.0
"""Mechanical work across the handle, separately for both directions.

Robot and module have mass and friction, so work flows in both directions also without assistance;
the share describes the movement, not the patient's ability.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np


class Work(NamedTuple):
    """Positive work [J] that the patient did on the robot, and the robot on the patient."""

    patient: float
    robot: float

    @property
    def robot_share(self) -> float:
        """Return the robot's share of both, 0 to 1; NaN when no work was done."""
        total = self.patient + self.robot
        return self.robot / total if total > 0.0 else math.nan


def work_done(force: np.ndarray, velocity: np.ndarray, times: np.ndarray) -> Work:
    """Return the work over a movement by the trapezoidal rule.

    force: of the patient on the robot [N], velocity [m/s], of shape (samples, axes); times [s].
    Samples without a valid force (NaN) have zero power.
    """
    power = np.nan_to_num(np.sum(force * velocity, axis=1))
    steps = np.diff(times)

    def integral(values: np.ndarray) -> float:
        return float(np.sum(0.5 * (values[1:] + values[:-1]) * steps))

    return Work(
        integral(np.maximum(power, 0.0)),
        integral(np.maximum(-power, 0.0)),
    )
