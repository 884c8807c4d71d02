# SPDX-License-Identifier: Apache-2.0
"""Inertia ellipses at the tip of the planar arm (thesis appendix D, fig 3).

With joint inertia M(q) and Jacobian J the inertia at the tip is J^-T M J^-1; a module of mass m at
the tip adds m in every direction. The axes of the ellipse are the eigenvalues [kg]; the anisotropy
is the ratio of the larger to the smaller one.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..geometry import MANUS, PlanarArm, inverse, jacobian


class JointInertia(NamedTuple):
    """M(q) = [[shoulder, coupling cos D], [coupling cos D, elbow]] [kg m^2].

    D is the angle between the links, elbow - shoulder.
    """

    shoulder: float
    elbow: float
    coupling: float


APPENDIX_D = JointInertia(0.173, 0.226, 0.171)
APPENDIX_D_ARM = MANUS._replace(base_y=-0.60)
"""Derived from appendix D, not measured: the paper prints no inertias. With its links and the base
0.60 m behind the workspace's centre these inertias reproduce all its printed figures: anisotropy
1.23 to 1.53, at most 4/3 kg without the module, 4 kg with a module of 2.7 kg."""

INMOTION2 = JointInertia(0.391, 0.228, 0.227)
INMOTION2_ARM = MANUS
"""Identified on a later commercial InMotion2, another robot than the thesis's."""

SETS = {
    "appendix_d": (APPENDIX_D, APPENDIX_D_ARM),
    "inmotion2": (INMOTION2, INMOTION2_ARM),
}


def tensor(
    x: float, y: float, joints: JointInertia, mass: float = 0.0, arm: PlanarArm = MANUS
) -> np.ndarray:
    """Return the inertia at the tip [kg], shape (2, 2), at x, y [m] from the workspace centre.

    mass: of the module at the tip [kg]. Raises ValueError when the point is out of reach.
    """
    reach = math.hypot(x - arm.base_x, y - arm.base_y)
    if not abs(arm.forearm - arm.upper_arm) < reach < arm.forearm + arm.upper_arm:
        raise ValueError(f"x = {x:g}, y = {y:g} m is out of reach of the planar arm")
    shoulder, elbow = inverse(x, y, arm)
    back = np.linalg.inv(np.reshape(jacobian(shoulder, elbow, arm), (2, 2)))
    across = joints.coupling * math.cos(elbow - shoulder)
    matrix = np.array([[joints.shoulder, across], [across, joints.elbow]])
    return back.T @ matrix @ back + mass * np.eye(2)


def tensors(
    points: np.ndarray, joints: JointInertia, mass: float = 0.0, arm: PlanarArm = MANUS
) -> np.ndarray:
    """Return the inertia [kg], shape (n, 2, 2), at points x, y [m], shape (n, 2)."""
    return np.array([tensor(float(x), float(y), joints, mass, arm) for x, y in points])


def grid(half_width: float, half_depth: float, columns: int, rows: int) -> np.ndarray:
    """Return points x, y [m], shape (columns * rows, 2), over the workspace, its edge included."""
    x, y = np.meshgrid(
        np.linspace(-half_width, half_width, columns), np.linspace(-half_depth, half_depth, rows)
    )
    return np.column_stack([x.ravel(), y.ravel()])


def anisotropy(inertia: np.ndarray) -> np.ndarray:
    """Return the ratio of the axes, shape (n,), of inertias of shape (n, 2, 2)."""
    minor, major = np.linalg.eigvalsh(inertia).T
    return major / minor


def least_anisotropy(joints: JointInertia, arm: PlanarArm = MANUS) -> float:
    """Return the least anisotropy in the arm's reach; it does not depend on the arm's direction."""
    angles = np.radians(np.linspace(1.0, 179.0, 357))
    reach = np.sqrt(
        arm.upper_arm**2 + arm.forearm**2 + 2.0 * arm.upper_arm * arm.forearm * np.cos(angles)
    )
    points = np.column_stack([np.full_like(reach, arm.base_x), arm.base_y + reach])
    inertia = np.array([tensor(float(x), float(y), joints, arm=arm) for x, y in points])
    return float(anisotropy(inertia).min())
