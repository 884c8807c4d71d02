# SPDX-License-Identifier: Apache-2.0
"""Compliant mounting of the screw (thesis appendix A, figs A-2, A-3, A-4, A-7): no trials.

The nut, at height z above the screw's centre, is the pivot. Springs k1 at the top and k2 at the
bottom hold the ends, l1 from the centre. Case 1: motor and flange move with the screw (eqs A.1,
A.2). Case 2: they are grounded. Case 3: a spring k3 connects them to ground as a tuned absorber
(eq A.3). All frequencies are those of small rotations about the nut.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from scipy import linalg, signal
from scipy.optimize import brentq

from ..settings import Setting
from . import screw_geometry
from .figures import COLOURS, DESIRED, axes_for, decibels, panels
from .lab import Lab
from .results import DERIVED, NOTHING, Drawn, Experiment, Published, Quantity, Result, beside
from .screw_geometry import DESCRIPTIONS, GROOVED, LEAD, NAMES, Bar, candidates

NAME = "compliant_mounting"
# 500 Hz is the design rule of A.1.1: case 1 is drawn for it, and for case 2 the thesis prints only
# that the frequency is acceptable. Its stiffness is an example.
THESIS = {
    "case1_frequency_least": Published("least_natural_frequency", 50.0),
    "case2_frequency_least": Published("least_natural_frequency", 50.0),
    "case2_softest": Published("case2_k", 3e5),
    "fastest_rotation": Published("fastest_rotation", 5.0),
    "case3_antiresonance": Published(
        "case3_dip", 100.0,
        "sqrt((k1 + k3) / Mtop) of the printed values is 1936 rad/s: probably a misprint of 2000",
    ),
}  # fmt: skip
_FASTEST = 1.0  # [m/s] thesis: fastest
_PRINTED_DIP = 200.0  # [rad/s] thesis: case3_dip
_LIMIT: dict[str, Any] = {"color": DESIRED, "linestyle": ":", "linewidth": 1.4}
_CANDIDATES = {
    "grooved": "15.9 mm, grooved",
    "outer": "15.9 mm, solid",
    "effective": "14.3 mm, solid",
    "table": "solid, reflecting 3.25 kg (Table 5.1)",
}


class Settings(NamedTuple):
    """Values printed in appendix A, and the candidate for the screw's missing data."""

    screw: Annotated[str, Setting("candidate for the screw", choices=NAMES)] = GROOVED
    inertia_across: Annotated[
        float, Setting("screw, across its axis, about its centre", "kg m^2", 1e-5, 10.0)
    ] = screw_geometry.INERTIA_ACROSS
    density: Annotated[float, Setting("of the screw", "kg/m^3", 500.0, 20000.0)] = (
        screw_geometry.STEEL
    )
    top_mass: Annotated[
        float, Setting("motor and flange", "kg", 0.01, 100.0)
    ] = 1.60  # thesis: case1_top_mass
    top_distance: Annotated[
        float, Setting("their centre of mass from the screw's", "m", 0.0, 2.0)
    ] = 0.344  # thesis: case1_top_distance
    travel: Annotated[
        float, Setting("of the nut, about the centre", "m", 0.01, 2.0)
    ] = 0.36  # thesis: travel
    case1_top: Annotated[float, Setting("k1 of case 1", "N/m", 1e2, 1e12)] = 4e7  # thesis: case1_k1
    case1_bottom: Annotated[
        float, Setting("k2 of case 1", "N/m", 1e2, 1e12)
    ] = 5e6  # thesis: case1_k2
    case2_top: Annotated[float, Setting("k1 of case 2", "N/m", 1e2, 1e12)] = 2e6  # thesis: case2_k
    case2_bottom: Annotated[
        float, Setting("k2 of case 2", "N/m", 1e2, 1e12)
    ] = 2e6  # thesis: case2_k
    case3_top: Annotated[float, Setting("k1 of case 3", "N/m", 1e2, 1e12)] = 3e6  # thesis: case3_k
    case3_bottom: Annotated[
        float, Setting("k2 of case 3", "N/m", 1e2, 1e12)
    ] = 3e6  # thesis: case3_k
    case3_ground: Annotated[
        float, Setting("k3 of case 3", "N/m", 1e2, 1e12)
    ] = 3e6  # thesis: case3_k
    case3_nut: Annotated[
        float, Setting("z of case 3", "m", -1.0, 1.0)
    ] = 0.0  # ours: at the centre, as in A.4
    wanted: Annotated[
        float, Setting("required natural frequency", "Hz", 1.0, 1e5)
    ] = 500.0  # thesis: least_natural_frequency


Profile = tuple[np.ndarray, np.ndarray]
"""Inertia about the nut [kg m^2] and natural frequency [Hz], one per position of the nut."""


def run(lab: Lab, settings: Settings) -> Result:
    """Evaluate the three cases. Raises ValueError if no l1 gives the wanted frequency."""
    screws, z = candidates(settings.inertia_across, settings.density), positions(settings)
    free = [case1(screw, z, settings) for screw in screws.values()]
    systems = {name: absorber(screw, settings) for name, screw in screws.items()}
    omega = np.geomspace(1e2, 2e4, 4000)
    data = {
        "nut": z,
        "screws": np.array(list(screws)),
        "case1_inertia": np.array([inertia for inertia, _ in free]),
        "case1_frequency": np.array([frequency for _, frequency in free]),
        "case2_frequency": np.array([
            profile(screw, z, settings.case2_top, settings.case2_bottom)[1]
            for screw in screws.values()
        ]),
        "omega": omega,
        "case3_response": response(systems[settings.screw], omega),
        "case3_resonances": np.array([resonances(s) for s in systems.values()]),
        "case3_antiresonance": np.array([_oscillating(_zeros(s))[0] for s in systems.values()]),
    }  # fmt: skip
    half_length = half_length_for(settings)
    return Result(
        NAME,
        beside(THESIS, _quantities(settings, screws, data, half_length), DERIVED),
        settings._asdict(),
        _notes(settings, screws, data, half_length),
        data,
    )


def profile(
    screw: Bar, z: np.ndarray, k1: float, k2: float, top_mass: float = 0.0, distance: float = 0.0
) -> Profile:
    """Return eqs A.1 and A.2 without damping, with the nut at z [m].

    k1, k2 [N/m]; top_mass [kg] at `distance` [m] above the screw's centre.
    """
    inertia = _across(screw) + screw.mass * z**2 + top_mass * (distance - z) ** 2
    stiffness = k1 * (screw.half_length - z) ** 2 + k2 * (screw.half_length + z) ** 2
    return inertia, np.sqrt(stiffness / inertia) / (2.0 * math.pi)


def absorber(screw: Bar, settings: Settings) -> signal.StateSpace:
    """Return case 3: torque on the screw about the nut [Nm] -> its angular velocity [rad/s].

    States: angular velocity, velocity of the top mass, forces in k1, k2, k3. Derived from the force
    balance of both masses, without damping as in the thesis. Eq A.3 in our text lacks a square in
    its first and b1 in its second element, and its inertia is that about the nut only at z = 0.
    """
    up, down = screw.half_length - settings.case3_nut, screw.half_length + settings.case3_nut
    inertia, mass = _across(screw) + screw.mass * settings.case3_nut**2, settings.top_mass
    a = [
        [0.0, 0.0, -up / inertia, -down / inertia, 0.0],
        [0.0, 0.0, 1.0 / mass, 0.0, -1.0 / mass],
        [settings.case3_top * up, -settings.case3_top, 0.0, 0.0, 0.0],
        [settings.case3_bottom * down, 0.0, 0.0, 0.0, 0.0],
        [0.0, settings.case3_ground, 0.0, 0.0, 0.0],
    ]
    b = [[1.0 / inertia], [0.0], [0.0], [0.0], [0.0]]
    return signal.StateSpace(a, b, [[1.0, 0.0, 0.0, 0.0, 0.0]], [[0.0]])


def resonances(system: signal.StateSpace) -> np.ndarray:
    """Return the natural frequencies of a system's oscillating poles, ascending [rad/s]."""
    return _oscillating(linalg.eigvals(system.A))


def response(system: signal.StateSpace, omega: np.ndarray) -> np.ndarray:
    """Return the complex frequency response of a case 3 at omega [rad/s], in rad/s per Nm.

    Computed from poles and zeros, as polynomials of this system are ill-conditioned.
    """
    gain = float((system.C @ system.B)[0, 0])
    return signal.freqs_zpk(_zeros(system), linalg.eigvals(system.A), gain, omega)[1]


def half_length_for(settings: Settings) -> float:
    """Return the l1 [m] with which case 1 has the required frequency at its worst position.

    The screw is modelled as a thin bar: its mass is 3 I / l1^2. Raises ValueError if no l1 between
    half the travel and 1 m fulfils it.
    """
    z = positions(settings)

    def excess(half: float) -> float:
        thin = Bar(3.0 * settings.inertia_across / half**2, 2.0 * half, 0.0)
        return float(case1(thin, z, settings)[1].min()) - settings.wanted

    low, high = settings.travel / 2.0, 1.0
    if excess(low) * excess(high) > 0.0:
        raise ValueError(
            f"wanted = {settings.wanted:g} Hz: no screw of this inertia gives it with these springs"
        )
    return float(brentq(excess, low, high))


def positions(settings: Settings) -> np.ndarray:
    """Return the positions of the nut over the travel [m] from the screw's centre."""
    return np.linspace(-settings.travel / 2.0, settings.travel / 2.0, 721)


def case1(screw: Bar, z: np.ndarray, settings: Settings) -> Profile:
    """Return the profile of case 1: motor and flange move with the screw; z [m]."""
    return profile(
        screw, z, settings.case1_top, settings.case1_bottom, settings.top_mass,
        settings.top_distance,
    )  # fmt: skip


def _across(screw: Bar) -> float:
    """Return a bar's inertia about its centre across its axis [kg m^2]."""
    return screw.mass * screw.length**2 / 12.0 + screw.inertia_axis / 2.0


def _zeros(system: signal.StateSpace) -> np.ndarray:
    """Return the zeros of a system with one input and one output [rad/s]."""
    pencil = np.block([[system.A, system.B], [system.C, system.D]])
    values = linalg.eigvals(pencil, linalg.block_diag(np.eye(len(system.A)), 0.0))
    return values[np.isfinite(values)]


def _oscillating(roots: np.ndarray) -> np.ndarray:
    """Return the moduli of the roots in the upper half plane, ascending, with a rounding margin."""
    scale = float(np.abs(roots).max(initial=0.0))
    return np.sort(np.abs(roots[roots.imag > 1e-6 * scale]))


def _quantities(
    settings: Settings, screws: dict[str, Bar], data: dict[str, np.ndarray], half_length: float
) -> tuple[Quantity, ...]:
    """Return the experiment's quantities; `half_length`: l1 for the required frequency [m].

    Uncertainties are the spread (one standard deviation) over the candidates for the screw.
    """
    names, bars = list(screws), screws.values()
    at = names.index(settings.screw)
    z, inertia = data["nut"], data["case1_inertia"]
    first, second = data["case1_frequency"], data["case2_frequency"]
    least = first.min(1)
    low, high = data["case3_resonances"].T

    def of(name: str, values: Sequence[float] | np.ndarray, unit: str, text: str) -> Quantity:
        values = np.asarray(values, float)
        return Quantity(name, float(values[at]), float(values.std(ddof=1)), unit, text)

    softest = settings.case2_top * (settings.wanted / second.min(1)) ** 2
    return (
        of("screw_mass", [bar.mass for bar in bars], "kg", "mass of the screw, derived"),
        of("screw_length", [bar.length for bar in bars], "m", "length of the screw, derived"),
        of("half_length", [bar.half_length for bar in bars], "m",
           "l1, centre of the screw to either bearing, derived"),
        of("screw_reflected_mass", [bar.reflected() for bar in bars], "kg",
           "mass the screw's rotation reflects to the handle (Table 5.1: 3.25 kg)"),
        Quantity("half_length_wanted", half_length, math.nan, "m",
                 f"l1 at which case 1 has just {settings.wanted:g} Hz at its worst position"),
        Quantity("fastest_rotation", _FASTEST / LEAD, math.nan, "Hz",
                 "turns per second at 1 m/s (thesis A.1.1: about 50 Hz)"),
        of("case1_inertia_greatest", inertia.max(1), "kg m^2",
           "case 1, inertia about the nut at the bottom of travel (fig A-2)"),
        of("case1_inertia_least", inertia.min(1), "kg m^2",
           "case 1, inertia about the nut at the top of travel (fig A-2)"),
        of("case1_frequency_least", least, "Hz",
           "case 1, least natural frequency over the travel (A.2, fig A-3: at least 500 Hz)"),
        of("case1_worst_position", z[first.argmin(1)], "m",
           "case 1, where that is, above the screw's centre (fig A-3)"),
        of("case1_frequency_greatest", first.max(1), "Hz",
           "case 1, greatest natural frequency over the travel (fig A-3)"),
        of("case2_frequency_least", second.min(1), "Hz",
           "case 2, least natural frequency over the travel (A.3, fig A-4: acceptable)"),
        of("case2_frequency_centre", second[:, len(z) // 2], "Hz",
           "case 2, natural frequency with the nut at the centre (fig A-4: the top of the curve)"),
        of("case2_softest", softest, "N/m",
           f"case 2, softest k1, k2 in proportion, for {settings.wanted:g} Hz "
           "(A.3: 2e6 N/m is acceptable)"),
        Quantity("case3_antiresonance", float(data["case3_antiresonance"][at]), math.nan, "rad/s",
                 "case 3, dip of velocity over torque (A.4, fig A-7: close to 200 rad/s as "
                 "printed)"),
        of("case3_resonance_low", low, "rad/s", "case 3, peak below the dip (fig A-7)"),
        of("case3_resonance_high", high, "rad/s", "case 3, peak above the dip (fig A-7)"),
        *(
            Quantity(f"{case}_frequency_least_{name}", float(values[number]), math.nan, "Hz",
                     f"{case[:-1]} {case[-1]}, least natural frequency, {DESCRIPTIONS[name]}")
            for case, values in (("case1", least), ("case2", second.min(1)))
            for number, name in enumerate(names)
        ),
    )  # fmt: skip


def _notes(
    settings: Settings, screws: dict[str, Bar], data: dict[str, np.ndarray], half_length: float
) -> tuple[str, ...]:
    lines = [
        f"screw '{name}' ({DESCRIPTIONS[name]}): {screw.mass:.3f} kg, {screw.length:.4f} m, "
        f"diameter of the equal cylinder {1e3 * screw.diameter:.2f} mm, reflects "
        f"{screw.reflected():.2f} kg; least natural frequency {first:.0f} Hz in case 1 and "
        f"{second:.0f} Hz in case 2"
        for (name, screw), first, second in zip(
            screws.items(),
            data["case1_frequency"].min(1),
            data["case2_frequency"].min(1),
            strict=True,
        )
    ]
    stiffness = settings.case3_top + settings.case3_ground
    dip = math.sqrt(stiffness / settings.top_mass)
    return (
        "The thesis prints neither the screw's mass and length nor l1. Assumed: candidate "
        f"'{settings.screw}', with l1 half its length. The default is the candidate that reaches "
        "the thesis's 500 Hz in case 1 with the least margin ('the most compliance possible'); the "
        "uncertainties are the spread over the candidates. "
        f"Exactly {settings.wanted:g} Hz requires l1 = {half_length:.4f} m "
        f"({half_length / 0.0254:.2f} in).",
        *lines,
        f"Case 3: undamped, the dip lies at sqrt((k1 + k3) / M_top) = {dip:.0f} rad/s "
        f"({dip / 2 / math.pi:.0f} Hz) for any screw. The printed 'close to 200 rad/sec' "
        f"would require k1 + k3 = {_PRINTED_DIP**2 * settings.top_mass:.3g} N/m instead of "
        f"{stiffness:.3g} N/m; 2000 is probably meant.",
        "Eq A.3 in our text of the thesis (by OCR) lacks the square in b1 (l1 - z)^2 of its "
        "first element and the factor b1 in its second; its inertia is about the screw's centre, "
        "which is correct only at z = 0. "
        "Here the equation is derived again. With b = 0 the printed second element would make the "
        "system very slightly unstable, without a change of peaks and dip.",
    )


def draw(result: Result) -> Drawn:
    """Return the figures of `compliant_mounting` by their number in the thesis."""
    return {
        "A-2": _over_nut(result, "case1_inertia", "moment of inertia about the nut [kg m²]",
                         "Fig. A-2: inertia about the nut, case 1"),
        "A-3": _over_nut(result, "case1_frequency", "natural frequency [Hz]",
                         "Fig. A-3: natural frequency, case 1"),
        "A-4": _over_nut(result, "case2_frequency", "natural frequency [Hz]",
                         "Fig. A-4: natural frequency, case 2"),
        "A-7": _absorber(result),
    }  # fmt: skip


def _over_nut(result: Result, name: str, label: str, title: str) -> Figure:
    """Draw a quantity against the position of the nut.

    Frequencies with one line per candidate for the screw; the inertias can hardly be distinguished.
    """
    figure, axes = axes_for("nut above the centre of the screw [m]", label, title)
    over = name.endswith("frequency")
    for number, screw in enumerate(result.data["screws"]):
        main = screw == result.settings["screw"]
        if main or over:
            axes.plot(
                result.data["nut"], result.data[name][number], color=COLOURS[number],
                linewidth=2.2 if main else 0.9, linestyle="-" if main else "--",
                label="screw " + _CANDIDATES[str(screw)] + (" (taken)" if main else ""),
            )  # fmt: skip
    if over:
        wanted = result.settings["wanted"]
        axes.axhline(wanted, label=f"wanted: {wanted:g} Hz", **_LIMIT)
    else:
        axes.set_ylim(bottom=0.0)
    figure.legend(loc="outside lower center", ncols=2)
    return figure


def _absorber(result: Result) -> Figure:
    """Draw magnitude and phase of velocity over torque with the tuned vibration absorber."""
    omega, response = result.data["omega"], result.data["case3_response"]
    at = list(result.data["screws"]).index(result.settings["screw"])
    dip, (low, high) = result.data["case3_antiresonance"][at], result.data["case3_resonances"][at]
    figure, (upper, lower) = panels(2, 1, (7.2, 5.4), sharex=True)
    upper.semilogx(omega, decibels(response), color=COLOURS[0])
    lower.semilogx(omega, np.degrees(np.angle(response)), color=COLOURS[0])
    for axes in (upper, lower):
        axes.axvline(dip, **_LIMIT)
    for at, text, height, side in (
        (dip, "dip", 0.02, "left"), (low, "peak", 0.9, "right"), (high, "peak", 0.9, "left"),
    ):  # fmt: skip
        upper.annotate(
            f"{text} {at:.0f} rad/s", (at, height), xycoords=upper.get_xaxis_transform(),
            fontsize=9, ha=side, xytext=(6 if side == "left" else -6, 0),
            textcoords="offset points",
        )  # fmt: skip
    upper.set(ylim=(-70.0, 40.0), ylabel="magnitude [dB re 1 rad/s per Nm]",
              title="Fig. A-7: tuned vibration absorber, velocity over torque")  # fmt: skip
    lower.set(xlabel="frequency [rad/s]", ylabel="phase [°]", yticks=[-90, -45, 0, 45, 90])
    return figure


EXPERIMENT = Experiment(
    NAME, "compliant mounting of the screw (thesis appendix A): no trials", Settings, run, draw,
    NOTHING,
)  # fmt: skip
