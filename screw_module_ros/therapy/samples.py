# SPDX-License-Identifier: Apache-2.0
"""One sample of the patient's hand, from `endpoint_state`."""

from __future__ import annotations

from typing import NamedTuple

Point = tuple[float, float, float]


class HandSample(NamedTuple):
    """Position, velocity and force of the hand, in frame manus_base.

    sequence: tick number; time_ns: stamp [ns]; x, y from the workspace centre and z from the bottom
    of travel [m]; vx, vy, vz [m/s]; fx, fy, fz: force of the patient on the robot [N]; stop: why
    the session must stop, empty if it may continue.
    """

    sequence: int
    time_ns: int
    x: float
    y: float
    z: float
    vx: float
    vy: float
    vz: float
    fx: float
    fy: float
    fz: float
    stop: str = ""

    @property
    def position(self) -> Point:
        """Return x, y, z [m]."""
        return self[2:5]

    @property
    def velocity(self) -> Point:
        """Return vx, vy, vz [m/s]."""
        return self[5:8]

    @property
    def force(self) -> Point:
        """Return fx, fy, fz [N]."""
        return self[8:11]
