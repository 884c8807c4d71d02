# SPDX-License-Identifier: Apache-2.0
"""Who does the work: the mechanical work across the handle, in both directions apart.

Robot and module have mass and friction, so a patient who is not assisted at all still gives and
takes some work; the share is a description of the movement, not of ability.
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
    Samples without a valid force (NaN) count as no power.
    """
    power = np.nan_to_num(np.sum(force * velocity, axis=1))
    steps = np.diff(times)

    def integral(values: np.ndarray) -> float:
        return float(np.sum(0.5 * (values[1:] + values[:-1]) * steps))

    return Work(
        integral(np.maximum(power, 0.0)),
        integral(np.maximum(-power, 0.0)),
    )
