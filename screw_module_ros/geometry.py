# SPDX-License-Identifier: Apache-2.0
"""Geometry of the robot: the screw that lifts the handle and the planar arm that carries it.

Screw (thesis 3.1.1; eqs 5.1, 5.2): z = L theta / 2 pi, F = 2 pi T / L. Height z is zero at the
bottom of travel and positive up.

Plane (thesis 2.2.2, MIT-MANUS): a five-bar linkage whose two motors stand at the base, so both
joint angles are absolute: the shoulder turns the upper arm, the elbow motor turns the forearm, each
measured from +x counter-clockwise in frame `manus_base` (x to the patient's right, y away from the
patient, origin in the centre of the workspace). The patient faces the robot (thesis 1.1): its base
stands beyond the workspace, and the arm is nearly stretched at the edge near the patient.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from .settings import Setting

COUNTS_PER_TURN = 20_000  # thesis: counts_per_turn
"""Counts of the motor's encoder per turn."""


class Screw(NamedTuple):
    """The screw. Encoder, drive position and torque must all use the same one."""

    lead: Annotated[
        float, Setting("travel of the nut per turn; the same in encoder and amplifier", "m",
                       1e-4, 0.1)
    ] = 0.01905  # thesis: lead


RIGHT, LEFT = "right", "left"
"""Sides of the elbow, as the patient sees them: +x and -x."""


class PlanarArm(NamedTuple):
    """Dimensions of the planar arm, position of its base, and the side of its elbow.

    The thesis gives none of MIT-MANUS. These are of an InMotion2, a later robot of the same family.
    """

    # imt2.cal of inmotionpy: "classic" links of 16 and 20.25 inches, "original planar" offset of
    # the workspace's centre from the base.
    upper_arm: Annotated[
        float, Setting("length of the upper arm", "m", 0.05, 2.0)
    ] = 0.4064  # public program: inmotionpy
    forearm: Annotated[
        float, Setting("length of the forearm", "m", 0.05, 2.0)
    ] = 0.51435  # public program: inmotionpy
    base_x: Annotated[
        float, Setting("base, x from the workspace centre", "m", -2.0, 2.0)
    ] = 0.0  # public program: inmotionpy
    base_y: Annotated[
        float, Setting("base, y from the workspace centre; beyond it, opposite the patient, is "
                       "positive", "m", -2.0, 2.0)
    ] = 0.60  # public program: inmotionpy
    elbow: Annotated[
        str, Setting("side of the elbow, seen by the patient: of the line from the base to the "
                     "workspace's centre", choices=(RIGHT, LEFT))
    ] = RIGHT  # ours

    @property
    def turn(self) -> float:
        """Sign of elbow - shoulder: -1 where the forearm turns on clockwise, seen from above.

        An elbow to the right is reached clockwise from a base beyond the workspace, and
        counter-clockwise from one on the patient's side.
        """
        return math.copysign(1.0, -self.base_y if self.elbow == RIGHT else self.base_y)


SCREW = Screw()
MANUS = PlanarArm()
MANUS_NAME = "five_bar"
"""Name of this kind of arm, among others (`control/arms.py`); the URDF describes no other."""


def counts_to_height(
    counts: float, screw: Screw = SCREW, counts_per_turn: int = COUNTS_PER_TURN
) -> float:
    """Return the travel of the nut [m] for counts of an encoder on the screw [counts]."""
    return counts * screw.lead / counts_per_turn


def force_to_torque(force: float, screw: Screw = SCREW) -> float:
    """Return the motor torque [Nm] for a force at the handle [N], without friction (eq 3.1)."""
    return force * screw.lead / (2.0 * math.pi)


def torque_to_force(torque: float, screw: Screw = SCREW) -> float:
    """Return the force at the handle [N] of a motor torque [Nm], without friction (eq 3.1)."""
    return 2.0 * math.pi * torque / screw.lead


def forward(shoulder: float, elbow: float, arm: PlanarArm = MANUS) -> tuple[float, float]:
    """Return the handle's x, y [m] from the workspace centre for absolute joint angles [rad]."""
    return (
        arm.base_x + arm.upper_arm * math.cos(shoulder) + arm.forearm * math.cos(elbow),
        arm.base_y + arm.upper_arm * math.sin(shoulder) + arm.forearm * math.sin(elbow),
    )


def inverse(x: float, y: float, arm: PlanarArm = MANUS) -> tuple[float, float]:
    """Return absolute joint angles [rad] that put the handle at x, y [m] from the workspace centre.

    Of the two solutions it returns the one with the elbow on its side, `arm.elbow`: elbow -
    shoulder lies in [0, pi] or in [-pi, 0]. The angles are continuous over the workspace and may
    pass pi. For a point out of reach the arm is stretched or folded towards it.
    """
    dx = x - arm.base_x
    dy = y - arm.base_y
    squared = dx * dx + dy * dy
    cosine = (squared - arm.upper_arm * arm.upper_arm - arm.forearm * arm.forearm) / (
        2.0 * arm.upper_arm * arm.forearm
    )
    between = arm.turn * math.acos(min(1.0, max(-1.0, cosine)))
    shoulder = math.atan2(dy, dx) - math.atan2(
        arm.forearm * math.sin(between), arm.upper_arm + arm.forearm * math.cos(between)
    )
    return shoulder, shoulder + between


def jacobian(
    shoulder: float, elbow: float, arm: PlanarArm = MANUS
) -> tuple[float, float, float, float]:
    """Return (dx/dshoulder, dx/delbow, dy/dshoulder, dy/delbow) [m/rad] at joint angles [rad]."""
    return (
        -arm.upper_arm * math.sin(shoulder),
        -arm.forearm * math.sin(elbow),
        arm.upper_arm * math.cos(shoulder),
        arm.forearm * math.cos(elbow),
    )
