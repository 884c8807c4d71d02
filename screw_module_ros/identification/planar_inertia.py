# SPDX-License-Identifier: Apache-2.0
"""Inertia of the planar arm at the handle (thesis appendix D, fig 3).

With joint inertia M(q) and Jacobian J the inertia at the tip is J^-T M J^-1. The axes of its
ellipse are the eigenvalues [kg]; the anisotropy is the ratio of the larger to the smaller one.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from ..geometry import MANUS, inverse, jacobian
from ..plant.planar import JointInertia
from ..plant.settings import load_world

ARM = MANUS


@cache
def joint_inertia() -> JointInertia:
    """Return the set `appendix_d` of `params/plant.yaml`, whatever set the simulated rig has.

    Derived from appendix D, not measured: the paper prints no inertias. With `ARM` it reproduces
    the printed anisotropy, 1.23 to 1.53, and keeps the bounds that the paper set itself: 4/3 kg
    without the module, 4 kg with one of 2.7 kg. Raises SettingError where the file cannot be read.
    """
    return load_world().planar.appendix_d


def tensor(x: float, y: float) -> np.ndarray:
    """Return the arm's inertia at the tip [kg], shape (2, 2), at x, y [m] from the centre.

    Raises ValueError when the point is out of reach.
    """
    if not abs(ARM.forearm - ARM.upper_arm) < math.hypot(x - ARM.base_x, y - ARM.base_y) < (
        ARM.forearm + ARM.upper_arm
    ):
        raise ValueError(f"x = {x:g}, y = {y:g} m is out of reach of the planar arm")
    shoulder, elbow = inverse(x, y, ARM)
    back = np.linalg.inv(np.reshape(jacobian(shoulder, elbow, ARM), (2, 2)))
    joints = joint_inertia()
    across = joints.coupling * math.cos(elbow - shoulder)
    return back.T @ np.array([[joints.shoulder, across], [across, joints.elbow]]) @ back


def grid(half_width: float, half_depth: float, count: int) -> np.ndarray:
    """Return points x, y [m], shape (count^2, 2), over the workspace, its edge included."""
    x, y = np.meshgrid(
        np.linspace(-half_width, half_width, count), np.linspace(-half_depth, half_depth, count)
    )
    return np.column_stack([x.ravel(), y.ravel()])


def anisotropy(inertia: np.ndarray) -> np.ndarray:
    """Return the ratio of the axes, shape (n,), of inertias of shape (n, 2, 2)."""
    minor, major = np.linalg.eigvalsh(inertia).T
    return major / minor
