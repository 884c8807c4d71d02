# SPDX-License-Identifier: Apache-2.0
"""What chapter 2 and appendix D asked of the robot, beside the thesis's machine and this one.

No trial: the values are those of other experiments, of the law's settings, and arithmetic on
printed numbers. A bound is met or missed by each of the ways to run the machine: modes 1 to 5 in
the vertical, with and without force feedback in the plane. A requirement without a value is not
tested, and says why.
"""

from __future__ import annotations

import math
import re
from typing import Annotated, Any, NamedTuple

import numpy as np

from ..control.friction import friction_force
from ..control.laws import variants
from ..control.limits import CommandLimits
from ..control.planar_settings import PlanarSettings
from ..settings import Setting, fields
from ..thesis import fact, figure
from . import (
    delivered_impedance,
    friction_model,
    gravity,
    planar_impedance,
    planar_inertia,
)
from .figures import COLOURS, CREDIT, DESIRED, panels
from .force_metric import apparent_mass
from .lab import Lab
from .report import number, scaled
from .results import DERIVED, NOTHING, Drawn, Experiment, Published, Quantity, Result, beside

NAME = "requirements"
MET, MISSED, UNTESTED = "met", "missed", "not tested"
VERTICAL = {f"mode_{mode}": variant.name.lower() for mode, variant in variants().items()}
"""Ways to run the vertical -> name in the results of `delivered_impedance`."""
PLANE = {
    "without_feedback": "none",
    "with_feedback_and_an_arm": "feedback",
    "with_feedback_and_a_firm_hand": "firm",
    "with_feedback_on_a_stiff_structure": "stiff",
}
"""Ways to run the plane -> case in the results of `planar_impedance`."""
_MACHINE = "machine"  # the one way where there is no choice
THESIS = {"design_factor_machine": Published("laden_design_factor", 0.05)}
_MAPPED = np.linspace(0.0, 0.355, 143)  # [m] heights of the friction maps (thesis 5.2.4)


class Requirement(NamedTuple):
    """One requirement.

    text; unit: of values and bound; machine: what the thesis says of its machine; key: of the bound
    in `params/thesis.yaml`, of a list the larger number, empty without one; least: the bound is the
    least, else the most; built: the machine's value for the figure, NaN = none; why: why there is
    no value, or what the value is not; asked_for: in words, where no bound says it.
    """

    text: str
    unit: str
    machine: str
    key: str = ""
    least: bool = False
    built: float = math.nan
    why: str = ""
    asked_for: str = ""

    @property
    def bound(self) -> float:
        """The bound [unit], NaN without one."""
        if not self.key:
            return math.nan
        part = 1 if isinstance(fact(self.key).value, list) else None
        return figure(self.key, part, self.unit)

    @property
    def asked(self) -> str:
        """What was asked, with its place in the thesis."""
        if not self.key:
            return self.asked_for
        low = "at least" if self.least else "at most"
        if isinstance(fact(self.key).value, list):
            low = f"{number(figure(self.key, 0, self.unit))} to"
        times, unit = scaled(self.bound, self.unit)
        return f"{low} {number(self.bound * times)} {unit}".strip() + f" ({fact(self.key).where})"

    def met(self, value: float) -> bool:
        """Return whether a value keeps the bound, within a thousandth; NaN does not."""
        return value >= self.bound * 0.999 if self.least else abs(value) <= self.bound * 1.001


REQUIREMENTS = {
    "vertical_friction": Requirement(
        "friction at the handle, vertical", "N",
        "about 10 N (6.1), 4 to 16 N by the trends of 5.2.5; 2 N with force gain 5 (6.4.3)",
        "d_vertical_friction", built=10.0,
    ),
    "vertical_inertia": Requirement(
        f"inertia at the handle, vertical, at {planar_impedance.HAND_HZ:g} Hz and below", "kg",
        "5.49 ± 1.72 kg (5.3.3)", "d_vertical_inertia", built=figure("mass"),
        why="mean of `delivered_impedance` where a hand moves",
    ),
    "rapid_inertia": Requirement(
        "inertia at the handle, vertical, at 4 Hz and above", "kg", "not measured",
        "d_vertical_inertia",
        why="median of `delivered_impedance`; modes 1 and 2 may have none there: the nut sticks",
    ),
    "force_up": Requirement(
        "force on the hand, upward", "N",
        "138.5 N at the motor's 0.42 Nm, less friction and weight (3.1.6)", "force_up", True,
        why="the largest command less weight and largest friction; the law limits spring and "
        "damper to 65 N",
    ),
    "force_down": Requirement(
        "force on the hand, downward", "N", "as upward", "force_down", True,
        why="as upward; the law limits spring and damper to 45 N",
    ),
    "arm_support": Requirement(
        "weight of a flaccid arm carried besides", "N", "not tested",
        asked_for="up to 20 N (2.1.1)",
        why="no law carries the arm: its weight is part of the spring's 65 N",
    ),
    "vertical_range": Requirement(
        "range of motion, vertical", "m", "0.36 m (3.1.3)", "d_vertical_range", True,
        built=figure("travel"),
    ),
    "backlash": Requirement(
        "backlash", "m", "there, not measured (6.4.3)", "d_backlash",
        why="what the plant was given, an assumption, as `gravity` finds it again",
    ),
    "off_axis_moment": Requirement(
        "moment of 112.5 N at the handle on the bearing", "Nm", "not measured",
        "guide_torque_capacity", why="arithmetic: the force that D wants withstood, times 77.85 mm",
    ),
    "off_axis_force": Requirement(
        "force of 112.5 N on the bearing", "N", "not measured", "guide_force_capacity",
        why="arithmetic: the force that D wants withstood",
    ),
    "back_friction": Requirement(
        "friction coefficient that still lets the nut turn the screw (eq 5)", "",
        "driven from both sides (2.3)", "d_mu_roller", True, why="arithmetic",
    ),
    "design_factor": Requirement(
        "design factor of the planar links with the module", "", "4.4 (2.2.4)",
        "manus_design_factor", True, built=figure("laden_design_factor"), why="arithmetic",
    ),
    "linear_motor": Requirement(
        "inertia in the plane with a linear motor of 15 kg", "kg", "not built (2.2.5)",
        "d_laden_inertia", why="arithmetic: why a screw was taken",
    ),
    "plane_inertia": Requirement(
        "inertia at the handle in the plane, with the module, heaviest direction", "kg",
        "not measured; 4/3 kg and 5.5 kg by design (D, 2.2.4)", "d_laden_inertia",
        built=figure("d_planar_inertia", 1) + figure("module_weight_estimate"),
        why="with feedback it returns where the guard takes the gain back (`planar_impedance`)",
    ),
    "plane_friction": Requirement(
        "friction at the handle in the plane, stiffest direction", "N", "not measured",
        "d_planar_friction", why="the plant's joints were given a friction that makes this range",
    ),
    "plane_bare_inertia": Requirement(
        "inertia of the plane without the module, heaviest direction", "kg", "not measured",
        "d_planar_inertia",
        why="calculation, whose inertias were chosen by this figure",
    ),
    "plane_anisotropy": Requirement(
        "anisotropy of the plane without the module", "", "1.23 to 1.53 by design (D)",
        "d_anisotropy_limit", built=figure("d_anisotropy", 1), why="calculation",
    ),
    "plane_viscous": Requirement(
        "frequency to which the impedance in the plane is mainly viscous", "Hz", "not measured",
        "d_viscous_to", True,
    ),
    "plane_sine": Requirement(
        "force for a sine of 1 Hz over 0.152 m, nobody at the handle", "N", "not measured",
        "d_static_force", why="arithmetic with the inertia found; the motion was not run",
    ),
    "plane_stiffness": Requirement(
        "stiffness in the plane", "N/m", "100 N/m is typical (6.1)", "d_stiffness", True,
        why="largest value that the setting takes",
    ),
    "slow_motion": Requirement(
        "smooth motion at very low speed", "m/s", "0.5 mm/s was driven from outside (5.2.3)",
        asked_for="no number (2.1.3)", why="no trial with the motor",
    ),
    "weight": Requirement(
        "weight of the planar robot", "N", "not printed", asked_for="311 N (D)",
        why="nothing to simulate",
    ),
}  # fmt: skip
"""Rows of the table in their order; the ways of each are those that have a value."""


class Settings(NamedTuple):
    """Numbers of the calculations."""

    lateral_force: Annotated[
        float, Setting("to be withstood at the handle", "N", 0.0, 1000.0)
    ] = figure("d_off_axis_withstand")
    handle_offset: Annotated[
        float, Setting("handle from the axis of the screw", "m", 0.0, 0.5)
    ] = figure("handle_offset")
    end_load: Annotated[
        float, Setting("vertical force for which the planar links were designed", "N", 1.0, 1000.0)
    ] = figure("manus_vertical_load")
    laden_load: Annotated[
        float, Setting("the same with the module's weight", "N", 1.0, 1000.0)
    ] = figure("laden_vertical_load")
    linear_motor: Annotated[
        float, Setting("mass of a linear motor", "kg", 0.0, 100.0)
    ] = figure("linear_motor_mass")
    sine_way: Annotated[
        float, Setting("of the sine in the plane", "m", 0.0, 1.0)
    ] = figure("d_bandwidth_motion")
    sine_frequency: Annotated[
        float, Setting("of this sine", "Hz", 0.0, 10.0)
    ] = figure("d_bandwidth")


_DESIGN = figure("manus_design_factor") * figure("manus_material_factor")


"""Factor of the plane without the module."""


class Row(NamedTuple):
    """A requirement with its values. found: way -> value, empty = not tested."""

    name: str
    wanted: Requirement
    found: dict[str, float]

    @property
    def verdict(self) -> str:
        """MET, MISSED, UNTESTED, or which ways meet it and which do not."""
        if not self.found:
            return UNTESTED
        by = {
            verdict: [way.replace("_", " ") for way, value in self.found.items()
                      if self.wanted.met(value) == (verdict == MET)]
            for verdict in (MET, MISSED)
        }  # fmt: skip
        if not by[MET] or not by[MISSED]:
            return MET if by[MET] else MISSED
        return "; ".join(f"{verdict}: {', '.join(ways)}" for verdict, ways in by.items())


def back_friction() -> float:
    """Return the greatest friction coefficient at which the nut still turns the screw (eq 5).

    tan(lead angle) cos(thread angle) at the effective diameter, with the flanks of the groove of
    3.1.1. `docs/thesis/appendix_d.ipynb` has the rest of appendix D's screw.
    """
    lead = figure("lead") / (math.pi * figure("effective_screw_diameter"))
    flank = (figure("groove_width_outer") - figure("groove_width_inner")) / (
        figure("screw_diameter") - figure("screw_inner_diameter")
    )
    return lead * math.cos(math.atan(flank * math.cos(math.atan(lead))))


def bare_plane() -> tuple[float, float]:
    """Return the largest inertia [kg] and anisotropy of the plane without the module.

    Over the workspace of 2.1.1, with the joint inertias derived from appendix D.
    """
    sides = figure("workspace_width") / 2.0, figure("workspace_depth") / 2.0
    inertia = np.array([planar_inertia.tensor(*point) for point in planar_inertia.grid(*sides, 41)])
    greatest = float(np.linalg.eigvalsh(inertia)[:, 1].max())
    return greatest, float(planar_inertia.anisotropy(inertia).max())


def run(lab: Lab, settings: Settings) -> Result:
    """Set what was asked beside what other experiments found. Raises MissingResult."""
    handle, plane = lab.result(delivered_impedance.NAME), lab.result(planar_impedance.NAME)
    weight = lab.result(gravity.NAME)
    bare, anisotropy = bare_plane()
    module: Any = lab.stand  # a simulated one: there is no other with the plane's results
    model = friction_model.friction_model_of(lab.result(friction_model.NAME))
    limits, planar = CommandLimits(), fields(PlanarSettings)
    fastest = model.fastest_mm_s * 1e-3
    up, down = (
        max(abs(friction_force(model, float(z), way * fastest)) for z in _MAPPED)
        for way in (1.0, -1.0)
    )
    heavy = weight.value("gravity")
    values: dict[str, dict[str, float]] = {
        "vertical_friction": _by(VERTICAL, handle, "friction_{}"),
        "vertical_inertia": _handled(handle),
        "rapid_inertia": _by(VERTICAL, handle, "mass_{}"),
        "force_up": {_MACHINE: limits.command_up - up - heavy},
        "force_down": {_MACHINE: limits.command_down - down + heavy},
        "vertical_range": {_MACHINE: module.world.vertical.travel},
        "backlash": {_MACHINE: weight.value("play")},
        "off_axis_moment": {_MACHINE: settings.lateral_force * settings.handle_offset},
        "off_axis_force": {_MACHINE: settings.lateral_force},
        "back_friction": {_MACHINE: back_friction()},
        "design_factor": {_MACHINE: _DESIGN * settings.end_load / settings.laden_load},
        "linear_motor": {_MACHINE: bare + settings.linear_motor},
        "plane_inertia": _by(PLANE, plane, "inertia_most_{}"),
        "plane_friction": _by(PLANE, plane, "friction_most_{}"),
        "plane_bare_inertia": {_MACHINE: bare},
        "plane_anisotropy": {_MACHINE: anisotropy},
        "plane_viscous": _by(PLANE, plane, "viscous_to_{}"),
        "plane_sine": {_MACHINE: plane.value("inertia_most_none") * 0.5 * settings.sine_way
                       * (2.0 * math.pi * settings.sine_frequency) ** 2},
        "plane_stiffness": {_MACHINE: planar["stiffness"].setting.high},
    }  # fmt: skip
    quantities = [
        Quantity(f"{name}_{way}", value, math.nan, REQUIREMENTS[name].unit,
                 f"{REQUIREMENTS[name].text}, {way.replace('_', ' ')}")
        for name, ways in values.items()
        for way, value in ways.items()
    ]  # fmt: skip
    result = Result(NAME, beside(THESIS, quantities, DERIVED), settings._asdict())
    untested = [f"{row.wanted.text} ({row.wanted.why})" for row in rows(result) if not row.found]
    return result._replace(notes=(*sentences(result), f"Not tested: {'; '.join(untested)}."))


def _by(ways: dict[str, str], result: Result, name: str) -> dict[str, float]:
    """Return the value of each way; a quantity that was not determined is left out."""
    known = {quantity.name: quantity.value for quantity in result.quantities}
    wanted = {way: name.format(own) for way, own in ways.items()}
    return {way: known[own] for way, own in wanted.items() if own in known}


def _handled(handle: Result) -> dict[str, float]:
    """Return the mean inertia [kg] of each mode at the frequencies of a hand."""
    frequencies = handle.data["frequencies"]
    hand = frequencies <= planar_impedance.HAND_HZ
    found = {}
    for way, name in VERTICAL.items():
        reactance = handle.data[f"reactance_{name}"]
        masses = apparent_mass(reactance, frequencies, handle.settings["stiffness"])[hand]
        if np.isfinite(masses).any():
            found[way] = float(np.nanmean(masses))
    return found


def rows(result: Result) -> list[Row]:
    """Return every requirement with the values of a result."""
    found: dict[str, dict[str, float]] = {name: {} for name in REQUIREMENTS}
    ways = (*VERTICAL, *PLANE, _MACHINE)
    for quantity in result.quantities:
        way = next(way for way in ways if quantity.name.endswith(f"_{way}"))
        found[quantity.name.removesuffix(f"_{way}")][way] = quantity.value
    return [Row(name, wanted, found[name]) for name, wanted in REQUIREMENTS.items()]


HEAD = ("requirement", "asked", "the thesis's machine", "simulated", "verdict")


def cells(result: Result) -> list[tuple[str, ...]]:
    """Return the rows of the table as text."""
    return [
        (row.wanted.text, row.wanted.asked, row.wanted.machine, _found_text(row), row.verdict)
        for row in rows(result)
    ]


def _found_text(row: Row) -> str:
    if not row.found:
        return row.wanted.why
    times, unit = scaled(min(row.found.values()), row.wanted.unit)
    told = [
        f"{way.replace('_', ' ')} {number(round(value * times, 2))}" if way != _MACHINE
        else number(value * times)
        for way, value in row.found.items()
    ]  # fmt: skip
    found = f"{', '.join(told)} {unit}".strip()
    return f"{found}; {row.wanted.why}" if row.wanted.why else found


def sentences(result: Result) -> tuple[str, ...]:
    """Return what the table says of friction and inertia, in the vertical and in the plane."""
    table = {row.name: row for row in rows(result)}
    friction, inertia = table["vertical_friction"], table["vertical_inertia"]
    both = [
        way for way in friction.found
        if friction.wanted.met(friction.found[way])
        and inertia.wanted.met(inertia.found.get(way, math.nan))
    ]  # fmt: skip
    named = " and ".join(
        f"{way.replace('_', ' ')} ({friction.found[way]:.2f} N, {inertia.found[way]:.2f} kg)"
        for way in both
    )
    rapid = table["rapid_inertia"]
    quick = [way.replace("_", " ") for way, mass in rapid.found.items() if rapid.wanted.met(mass)]
    who = {0: "none meets", 1: f"{named} alone meets"}.get(len(both), f"{named} meet")
    vertical = (
        f"In the vertical, of modes 1 to 5, {who} what appendix D asks of "
        f"friction ({friction.wanted.bound:.3g} N at most) and of inertia "
        f"({inertia.wanted.bound:g} kg at most) in the motion of a hand, "
        f"{planar_impedance.HAND_HZ:g} Hz and below; at 4 Hz and above "
        f"{' and '.join(quick) or 'none'} of those with a value keeps that inertia."
    )
    plane = table["plane_inertia"]
    parts = "; ".join(
        f"{mass:.2g} kg {way.replace('_', ' ').replace('feedback', 'force feedback')}, "
        f"which {'meets' if plane.wanted.met(mass) else 'misses'} it"
        for way, mass in plane.found.items()
    )
    return (
        vertical,
        f"In the plane it asks for at most {plane.wanted.bound:g} kg with the module. The hand "
        f"moves {parts}. Where feedback leaves much of the mass, the guard has taken its gain "
        "back: the structure under the module bends, and the loop would oscillate on it.",
    )


def draw(result: Result) -> Drawn:
    """Draw each value over its bound; what is right of the line misses it."""
    drawn = [row for row in rows(result) if any(row.found.values())][::-1]
    colours = {way: COLOURS[n] for ways in (VERTICAL, PLANE) for n, way in enumerate(ways)}
    sheet, axes = panels(size=(9.0, 1.4 + 0.34 * len(drawn)))
    axes.axvline(1.0, color=DESIRED, linewidth=0.8)
    point: dict[str, Any] = {"linestyle": "", "markersize": 7.0}
    for height, (_, wanted, found) in enumerate(drawn):
        for way, value in found.items():
            own = {"color": colours.get(way, DESIRED), "marker": _mark(way), **point}
            axes.plot(_over(wanted, value) if value else math.nan, height, **own)
        axes.plot(_over(wanted, wanted.built), height, color=DESIRED, **_THESIS_MARK)
    axes.set(xscale="log", xlabel="value over the most that is asked, or the least over the value",
             title="What was asked, and what is there: left of the line meets it")  # fmt: skip
    labels = [re.sub(", .*est direction", "", wanted.text) for _, wanted, _ in drawn]
    axes.set_yticks(range(len(drawn)), labels, fontsize=8)
    shapes = {"$1$": "modes 1 to 5", "o": "without feedback, or the machine"}
    for mark, text in {**shapes, **{_mark(w): w.replace("_", " ") for w in [*PLANE][1:]}}.items():
        axes.plot([], [], marker=mark, color=DESIRED, label=text, **point)
    axes.plot([], [], color=DESIRED, label=f"thesis ({CREDIT})", **_THESIS_MARK)
    sheet.legend(loc="outside lower center", ncols=2)
    return {"requirements": sheet}


_THESIS_MARK: dict[str, Any] = {
    "marker": "D", "linestyle": "", "markersize": 9.0, "markerfacecolor": "none"
}  # fmt: skip


def _mark(way: str) -> str:
    if way in VERTICAL:
        return f"${way[-1]}$"
    return dict(zip(PLANE, "os^v", strict=True)).get(way, "o")


def _over(wanted: Requirement, value: float) -> float:
    """Return how far a value is from its bound, above 1 beyond it."""
    return wanted.bound / value if wanted.least else abs(value) / wanted.bound


EXPERIMENT = Experiment(
    NAME, "what chapter 2 and appendix D asked, beside the thesis's machine and ours: no trials",
    Settings, run, draw, NOTHING,
    (delivered_impedance.NAME, planar_impedance.NAME, gravity.NAME, friction_model.NAME),
)  # fmt: skip
