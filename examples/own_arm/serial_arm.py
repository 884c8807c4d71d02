# SPDX-License-Identifier: Apache-2.0
"""A serial arm, for the robot: its second motor sits in the elbow and measures the angle there."""

import math
from typing import Annotated, NamedTuple

from screw_module_ros.control.arms import Arm
from screw_module_ros.settings import Setting


class SerialArm(NamedTuple):
    """Parameters arm.upper, arm.fore, arm.base_y of `manus`."""

    upper: Annotated[float, Setting("length of the upper arm", "m", 0.05, 2.0)] = 0.42
    fore: Annotated[float, Setting("length of the forearm", "m", 0.05, 2.0)] = 0.45
    base_y: Annotated[float, Setting("base, from the workspace centre", "m", -2.0, 2.0)] = 0.60


def forward(shoulder, elbow, own):
    """The handle's x, y [m] at angles [rad]: that of the upper arm, and that between the links."""
    fore = shoulder + elbow
    return (
        own.upper * math.cos(shoulder) + own.fore * math.cos(fore),
        own.base_y + own.upper * math.sin(shoulder) + own.fore * math.sin(fore),
    )


def inverse(x, y, own):
    """The angles there, with the elbow to the patient's right."""
    dy = y - own.base_y
    cosine = (x * x + dy * dy - own.upper**2 - own.fore**2) / (2.0 * own.upper * own.fore)
    elbow = -math.acos(min(1.0, max(-1.0, cosine)))
    shoulder = math.atan2(dy, x) - math.atan2(
        own.fore * math.sin(elbow), own.upper + own.fore * math.cos(elbow)
    )
    return shoulder, elbow


def jacobian(shoulder, elbow, own):
    """dx/dshoulder, dx/delbow, dy/dshoulder, dy/delbow [m/rad]."""
    fore = shoulder + elbow
    x_e, y_e = -own.fore * math.sin(fore), own.fore * math.cos(fore)
    return x_e - own.upper * math.sin(shoulder), x_e, y_e + own.upper * math.cos(shoulder), y_e


def between(shoulder, elbow, own):
    """The angle between the links, which the second motor turns alone."""
    return elbow, 0.0, 1.0


def singular(own):
    """The Jacobian's determinant [m^2] up to which the arm counts as stretched or folded."""
    return 0.02 * own.upper * own.fore


SERIAL = Arm(
    "serial", SerialArm, forward, inverse, jacobian, between, singular,
    {"shoulder_low": -1.7, "shoulder_high": 0.6, "elbow_low": -2.6, "elbow_high": -0.5,
     "between_low": -2.6, "between_high": -0.5},
)  # fmt: skip
