# SPDX-License-Identifier: Apache-2.0
"""The mass felt at the handle, summed over the components (thesis 5.3.1, Table 5.1): no trials.

Rotating parts count with their reflected mass, I (2 pi / L)^2 (eq 5.4). The rotor's is computed
from its data sheet, the screw's from the geometry of appendix A; the others are printed values.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from ..settings import Setting
from ..thesis import figure
from .lab import Lab
from .results import (
    DERIVED,
    GIVEN,
    NOTHING,
    Experiment,
    Published,
    Quantity,
    Result,
    beside,
    no_figures,
)
from .screw_geometry import (
    GROOVED,
    INERTIA_ACROSS,
    LEAD,
    NAMES,
    REFLECTED,
    STEEL,
    TABLE,
    Bar,
    candidates,
    reflected_mass,
)

NAME = "component_masses"
_GEOMETRY = "Table 5.1's screw and appendix A's inertia do not fit one bar of the measured diameter"
THESIS = {
    "motor_rotor": Published("reflected_motor_rotor", 0.02),
    "screw": Published("reflected_screw", 0.7, _GEOMETRY),
    "sum_computed": Published("mass_estimated", 0.7, _GEOMETRY),
    "measured_below_printed": Published("mass_below_estimate", 0.01),
    "moving_mass": Published("translating_mass_about", 0.2),
}
PRINTED = {
    "bearing_carriage": figure("mass_bearing_carriage"),
    "nut": figure("mass_nut"),
    "mounting_bracket": figure("mass_mounting_bracket"),
    "force_transducer": figure("mass_force_transducer"),
    "motor_rotor": figure("reflected_motor_rotor"),
    "screw": REFLECTED,
    "coupling": figure("reflected_coupling"),
}
"""Table 5.1 [kg], in its order."""
TRANSLATING = ("bearing_carriage", "nut", "mounting_bracket", "force_transducer")
_ROUNDING = 0.01 / math.sqrt(12.0)  # one standard deviation of a mass printed to 0.01 kg
_GRAVITY = 9.81
Masses = dict[str, float]
"""Masses by component, or by candidate for the screw [kg]."""


class Settings(NamedTuple):
    """Data of the computed components, and measured values for comparison with the sums."""

    lead: Annotated[float, Setting("travel of the nut per turn", "m", 1e-4, 0.1)] = LEAD
    rotor_inertia: Annotated[
        float, Setting("of the motor", "kg m^2", 1e-8, 1e-2)
    ] = 1.96e-5  # thesis: rotor_inertia
    screw: Annotated[str, Setting("candidate for the screw", choices=NAMES)] = GROOVED
    inertia_across: Annotated[
        float, Setting("screw, across its axis, about its centre", "kg m^2", 1e-5, 10.0)
    ] = INERTIA_ACROSS
    density: Annotated[float, Setting("of the screw", "kg/m^3", 500.0, 20000.0)] = STEEL
    measured: Annotated[
        float, Setting("mass measured in 5.3.3", "kg", 0.0, 1e3)
    ] = 5.49  # thesis: mass
    measured_sd: Annotated[
        float, Setting("its standard deviation", "kg", 0.0, 1e3)
    ] = 1.72  # thesis: mass_sd
    weight: Annotated[
        float, Setting("gravity measured in 5.2.4", "N", 0.0, 1e4)
    ] = 10.04  # thesis: weight
    weight_sd: Annotated[
        float, Setting("its standard deviation", "N", 0.0, 1e4)
    ] = 0.53  # ours: half of double_weight_sd


def run(lab: Lab, settings: Settings) -> Result:
    """Sum the table as printed and as computed."""
    screws = candidates(settings.inertia_across, settings.density)
    reflected = {name: screw.reflected(settings.lead) for name, screw in screws.items()}
    rotor = reflected_mass(settings.rotor_inertia, settings.lead)
    ours = PRINTED | {"motor_rotor": rotor, "screw": reflected[settings.screw]}
    sums = {name: sum(ours.values()) - ours["screw"] + reflected[name] for name in reflected}
    data = {
        "components": np.array(list(PRINTED)),
        "printed": np.array(list(PRINTED.values())),
        "computed": np.array(list(ours.values())),
        "screws": np.array(list(screws)),
        "screw_reflected": np.array(list(reflected.values())),
        "sums": np.array(list(sums.values())),
    }
    return Result(
        NAME,
        _quantities(settings, ours, reflected, sums),
        settings._asdict(),
        _notes(settings, screws, sums),
        data,
    )


def _quantities(
    settings: Settings, ours: Masses, reflected: Masses, sums: Masses
) -> tuple[Quantity, ...]:
    spread = float(np.std(list(reflected.values()), ddof=1))
    errors = dict.fromkeys(PRINTED, _ROUNDING) | {"motor_rotor": math.nan, "screw": spread}
    parts = tuple(
        Quantity(name, ours[name], errors[name], "kg", _remark(name)) for name in PRINTED
    )
    printed = sum(PRINTED.values())
    rounding = math.sqrt(len(PRINTED)) * _ROUNDING
    less = settings.measured_sd / printed
    moving = sum(ours[name] for name in TRANSLATING)
    weighed = settings.weight / _GRAVITY
    weighed_sd = settings.weight_sd / _GRAVITY
    computed = (
        Quantity("sum_printed", printed, rounding, "kg",
                 "sum of Table 5.1's contributions as printed (thesis: 6.42 kg)"),
        Quantity("sum_computed", sums[settings.screw], spread, "kg",
                 "the same with rotor and screw computed (Table 5.1: 6.42 kg)"),
        Quantity("measured_less_printed", settings.measured - printed,
                 math.hypot(settings.measured_sd, rounding), "kg",
                 "mass measured (5.3.3: 5.49 kg) less the printed sum"),
        Quantity("measured_below_printed", 1.0 - settings.measured / printed, less, "",
                 "share by which the measured mass is below the printed sum (5.3.3: about 15 %)"),
        Quantity("measured_less_computed", settings.measured - sums[settings.screw],
                 math.hypot(settings.measured_sd, spread), "kg",
                 "mass measured (5.3.3: 5.49 kg) less the computed sum"),
        Quantity("moving_mass", moving, math.sqrt(len(TRANSLATING)) * _ROUNDING, "kg",
                 "parts that move up and down upstream of the transducer (5.2.4: about 1 kg)"),
        Quantity("weighed_mass", weighed, weighed_sd, "kg",
                 "gravity of 10.04 N (5.2.4) as a mass"),
        Quantity("weighed_less_moving", weighed - moving, weighed_sd, "kg",
                 "mass weighed that the table's moving parts do not account for"),
    )  # fmt: skip
    found = beside(THESIS, parts + computed, DERIVED)
    given = set(PRINTED) - {"motor_rotor", "screw"}
    return tuple(q._replace(kind=GIVEN) if q.name in given else q for q in found)


def _remark(name: str) -> str:
    text = {
        "motor_rotor": "reflected mass of the motor's rotor, computed (Table 5.1: 2.13 kg)",
        "screw": "reflected mass of the screw, from appendix A's inertia (Table 5.1: 3.25 kg)",
        "coupling": "reflected mass of the coupling, as printed (Table 5.1: 0.22 kg)",
    }
    plain = name.replace("_", " ")
    return text.get(name, f"{plain}, as printed (Table 5.1: {PRINTED[name]:.2f} kg)")


def _notes(settings: Settings, screws: dict[str, Bar], sums: Masses) -> tuple[str, ...]:
    each = "; ".join(
        f"'{name}' reflects {screw.reflected(settings.lead):.2f} kg, sum {sums[name]:.2f} kg"
        for name, screw in screws.items()
    )
    return (
        "The printed contributions add up to 6.42 kg. The rotor's is computed from its data sheet. "
        "Carriage (data sheet), nut, bracket and transducer (weighed) and coupling (geometry not "
        "printed) are printed values.",
        f"The screw's 3.25 kg and appendix A's {settings.inertia_across:g} kg m^2 do not fit one "
        "solid steel bar of the measured diameter, 15.875 mm: the bar would have a diameter of "
        f"{1e3 * screws[TABLE].diameter:.1f} mm. Candidates: {each}. With the measured diameters "
        "and appendix A's inertia the sum is nearer to the measured "
        f"{settings.measured:g} kg, so the mass of Table 5.1's screw may be too large. The "
        f"measurement's standard deviation, {settings.measured_sd:g} kg, cannot decide it.",
        "Uncertainties: rounding for printed masses, spread over the candidates for the screw. The "
        "standard deviation of the measured mass is that of single samples.",
    )


EXPERIMENT = Experiment(
    NAME, "the mass felt at the handle, summed over the components (thesis 5.3.1): no trials",
    Settings, run, no_figures, NOTHING,
)  # fmt: skip
