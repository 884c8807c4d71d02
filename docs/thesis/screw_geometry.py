# SPDX-License-Identifier: Apache-2.0
"""Candidates for the screw, whose mass and length the thesis does not print.

The thesis prints the moment of inertia across the axis (appendix A), diameters and groove (3.1.1)
and the reflected mass at the handle (Table 5.1). Each candidate is a uniform steel bar whose length
follows from the moment of inertia. Its mass and its inertia about the axis are proportional to its
length L; its inertia across the axis is m L^2 / 12 + I_axis / 2.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from scipy.optimize import brentq

from screw_module_ros.thesis import figure

INERTIA_ACROSS = figure("screw_inertia_across")
"""Inertia about the centre of mass, across the axis [kg m^2]."""
STEEL = 7850.0
"""Density of ordinary steel [kg/m^3], ours."""
OUTER_DIAMETER = figure("screw_diameter", unit="m")
INNER_DIAMETER = figure("screw_inner_diameter", unit="m")
EFFECTIVE_DIAMETER = figure("effective_screw_diameter", unit="m")
"""Diameters of the shaft, of the groove's bottom, of the roller's track [m]."""
GROOVE_AT_INNER = figure("groove_width_inner", unit="m")
GROOVE_AT_OUTER = figure("groove_width_outer", unit="m")
"""Width of the groove [m] at the two diameters."""
LEAD = figure("lead", unit="m")
"""Travel of the nut per turn [m]."""
REFLECTED = figure("reflected_screw")
"""Mass that the rotation of the screw reflects to the handle [kg]: inertia, nothing that moves."""

GROOVED, OUTER, EFFECTIVE, TABLE = "grooved", "outer", "effective", "table"
NAMES = (GROOVED, OUTER, EFFECTIVE, TABLE)
DESCRIPTIONS = {
    GROOVED: "steel of 15.875 mm less the groove measured in 3.1.1",
    OUTER: "solid steel of the outer diameter, 15.875 mm",
    EFFECTIVE: "solid steel of the effective diameter, 14.2875 mm",
    TABLE: "solid steel whose rotation reflects Table 5.1's 3.25 kg",
}


class Bar(NamedTuple):
    """A uniform bar. mass [kg]; length [m]; inertia_axis: about its axis [kg m^2]."""

    mass: float
    length: float
    inertia_axis: float

    @property
    def half_length(self) -> float:
        """Return the distance from the centre to either bearing, the thesis's l1 [m]."""
        return self.length / 2.0

    @property
    def diameter(self) -> float:
        """Return the diameter of the solid cylinder of this mass and inertia [m]."""
        return math.sqrt(8.0 * self.inertia_axis / self.mass)

    def reflected(self, lead: float = LEAD) -> float:
        """Return the mass its rotation reflects to the handle [kg] (thesis eq 5.4)."""
        return reflected_mass(self.inertia_axis, lead)


def reflected_mass(inertia: float, lead: float = LEAD) -> float:
    """Return the mass at the handle [kg] of an inertia [kg m^2] that turns with the screw."""
    return inertia * (2.0 * math.pi / lead) ** 2


def bar(mass_per_metre: float, axis_per_metre: float, inertia_across: float) -> Bar:
    """Return the bar of this cross-section [kg/m], [kg m] whose inertia across is [kg m^2]."""

    def excess(length: float) -> float:
        across = mass_per_metre * length**3 / 12.0 + axis_per_metre * length / 2.0
        return across - inertia_across

    longest = (12.0 * inertia_across / mass_per_metre) ** (1.0 / 3.0)
    length = brentq(excess, 0.0, longest)
    return Bar(mass_per_metre * length, length, axis_per_metre * length)


def cylinder(diameter: float, inertia_across: float, density: float = STEEL) -> Bar:
    """Return the solid cylinder of a diameter [m] with this inertia across its axis [kg m^2]."""
    radius = diameter / 2.0
    per_metre = density * math.pi * radius**2
    return bar(per_metre, per_metre * radius**2 / 2.0, inertia_across)


def candidates(inertia_across: float = INERTIA_ACROSS, density: float = STEEL) -> dict[str, Bar]:
    """Return the candidates with this inertia across the axis [kg m^2], by name."""

    def reflects_too_much(diameter: float) -> float:
        return cylinder(diameter, inertia_across, density).reflected() - REFLECTED

    return {
        GROOVED: _grooved(inertia_across, density),
        OUTER: cylinder(OUTER_DIAMETER, inertia_across, density),
        EFFECTIVE: cylinder(EFFECTIVE_DIAMETER, inertia_across, density),
        TABLE: cylinder(brentq(reflects_too_much, 0.004, 0.06), inertia_across, density),
    }


def _grooved(inertia_across: float, density: float) -> Bar:
    """Return the bar of the outer diameter minus its helical groove."""
    solid = density * math.pi * OUTER_DIAMETER**2 / 4.0
    depth = (OUTER_DIAMETER - INNER_DIAMETER) / 2.0
    section = depth * (GROOVE_AT_INNER + GROOVE_AT_OUTER) / 2.0
    helix_per_metre = math.hypot(math.pi * EFFECTIVE_DIAMETER, LEAD) / LEAD
    cut = density * section * helix_per_metre
    axis = solid * OUTER_DIAMETER**2 / 8.0 - cut * EFFECTIVE_DIAMETER**2 / 4.0
    return bar(solid - cut, axis, inertia_across)
