# SPDX-License-Identifier: Apache-2.0
"""Back-drivability of screw, plane and belt (thesis appendix D, eqs 1 to 6, fig 3): no trials.

Screw: a block on a wedge with lead angle phi, thread angle theta and friction mu. A force F on the
nut turns the screw with P (eq 4) if the nut slides (eq 5); in the other direction P lifts the nut
(eq 6). Plane: the inertia ellipse of the tip with and without the module. Belt: the model of the
drive that was not built.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from ..settings import Setting, validated
from . import belt_drive
from .back_drive_report import notes, quantities
from .endpoint_inertia import SETS, anisotropy, grid, least_anisotropy, tensors
from .lab import Lab
from .results import Result
from .screw_geometry import (
    EFFECTIVE_DIAMETER,
    GROOVE_AT_INNER,
    GROOVE_AT_OUTER,
    INNER_DIAMETER,
    LEAD,
    OUTER_DIAMETER,
)

NAME = "back_drive"

FLANK_ANGLE = math.atan((GROOVE_AT_OUTER - GROOVE_AT_INNER) / (OUTER_DIAMETER - INNER_DIAMETER))
"""Slope of the groove's flanks [rad], from its widths at the two diameters (thesis 3.1.1)."""


class Settings(NamedTuple):
    """Screw, friction, planar arm and module."""

    lead: Annotated[float, Setting("travel of the nut per turn", "m", 1e-4, 0.1)] = LEAD
    diameter: Annotated[
        float, Setting("effective diameter of the screw", "m", 1e-3, 0.2)
    ] = EFFECTIVE_DIAMETER
    flank_angle: Annotated[
        float, Setting("of the thread, in a plane through the axis", "rad", 0.0, 1.2)
    ] = FLANK_ANGLE
    plastic: Annotated[float, Setting("friction of a plastic screw", "", 0.0, 1.0)] = 0.15
    roller: Annotated[float, Setting("friction of a roller screw", "", 0.0, 1.0)] = 0.015
    module_mass: Annotated[float, Setting("of the vertical module", "kg", 0.0, 50.0)] = 2.7
    plane: Annotated[
        str, Setting("inertias of the planar arm and its base, by name", choices=tuple(SETS))
    ] = "appendix_d"
    half_width: Annotated[float, Setting("half the workspace in x", "m", 0.01, 0.5)] = 0.1905
    half_depth: Annotated[float, Setting("half the workspace in y", "m", 0.01, 0.5)] = 0.2286
    heaviest: Annotated[
        float, Setting("largest inertia allowed in the plane", "kg", 0.1, 100.0)
    ] = 4.0


class Wedge(NamedTuple):
    """The thread, unwrapped: lead angle phi and thread angle theta [rad], friction mu."""

    lead_angle: float
    thread_angle: float
    friction: float

    @property
    def back_limit(self) -> float:
        """Return the greatest friction with which the nut turns the screw (eq 5)."""
        return math.tan(self.lead_angle) * math.cos(self.thread_angle)

    @property
    def forward_limit(self) -> float:
        """Return the greatest friction with which the screw lifts the nut (eq 6)."""
        return math.cos(self.thread_angle) / math.tan(self.lead_angle)

    def back_efficiency(self) -> float:
        """Return the share of the nut's force that turns the screw (eq 4), 0 when it sticks."""
        steep, cosine, mu = self._terms()
        return max(0.0, (cosine * steep - mu) / (cosine + mu * steep) / steep)

    def forward_efficiency(self) -> float:
        """Return the share of the screw's torque that lifts the nut, 0 when it sticks."""
        steep, cosine, mu = self._terms()
        return max(0.0, steep * (cosine - mu * steep) / (cosine * steep + mu))

    def _terms(self) -> tuple[float, float, float]:
        return math.tan(self.lead_angle), math.cos(self.thread_angle), self.friction


def wedge(settings: Settings, friction: float) -> Wedge:
    """Return the module's screw; theta is the flank's angle in the plane across the thread."""
    lead_angle = math.atan(settings.lead / (math.pi * settings.diameter))
    across = math.atan(math.tan(settings.flank_angle) * math.cos(lead_angle))
    return Wedge(lead_angle, across, friction)


def run(lab: Lab, settings: Settings) -> Result:
    """Evaluate screw, plane and belt.

    Raises ValueError for settings out of range and for a workspace beyond the arm's reach.
    """
    validated(settings)
    joints, arm = SETS[settings.plane]
    area = grid(settings.half_width, settings.half_depth, 41, 41)
    bare = tensors(area, joints, arm=arm)
    laden = bare + settings.module_mass * np.eye(2)
    shown = grid(settings.half_width, settings.half_depth, 3, 3)
    friction = np.linspace(0.0, 0.5, 101)
    screws = [wedge(settings, mu) for mu in friction]
    data = {
        "points": area,
        "anisotropy_bare": anisotropy(bare),
        "anisotropy_laden": anisotropy(laden),
        "axes_bare": np.linalg.eigvalsh(bare),
        "axes_laden": np.linalg.eigvalsh(laden),
        "shown_points": shown,
        "shown_bare": tensors(shown, joints, arm=arm),
        "shown_laden": tensors(shown, joints, settings.module_mass, arm),
        "anisotropy_possible": np.array(least_anisotropy(joints, arm)),
        "heaviest": np.array(settings.heaviest),
        "module_mass": np.array(settings.module_mass),
        "friction": friction,
        "back_efficiency": np.array([screw.back_efficiency() for screw in screws]),
        "forward_efficiency": np.array([screw.forward_efficiency() for screw in screws]),
    }
    screw_pair = (wedge(settings, settings.plastic), wedge(settings, settings.roller))
    return Result(
        NAME,
        quantities(settings, *screw_pair, data, belt_drive.chosen()),
        settings._asdict(),
        notes(settings, data),
        data,
    )
