# SPDX-License-Identifier: Apache-2.0
"""Compliant mounting of the screw (thesis appendix A, figs A-2, A-3, A-4, A-7): no trials.

The nut, at height z above the screw's centre, is the pivot. Springs k1 at the top and k2 at the
bottom hold the ends, l1 from the centre. Case 1: motor and flange move with the screw (eqs A.1,
A.2). Case 2: they are grounded. Case 3: a spring k3 connects them to ground as a tuned absorber
(eq A.3). All frequencies are those of small rotations about the nut.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
from scipy import linalg, signal
from scipy.optimize import brentq

from ..settings import Setting, validated
from . import screw_geometry
from .lab import Lab
from .mounting_report import notes, quantities
from .results import Result
from .screw_geometry import GROOVED, NAMES, Bar, candidates

NAME = "compliant_mounting"


class Settings(NamedTuple):
    """Values printed in appendix A, and the candidate for the screw's missing data."""

    screw: Annotated[str, Setting("candidate for the screw", choices=NAMES)] = GROOVED
    inertia_across: Annotated[
        float, Setting("screw, across its axis, about its centre", "kg m^2", 1e-5, 10.0)
    ] = screw_geometry.INERTIA_ACROSS
    density: Annotated[float, Setting("of the screw", "kg/m^3", 500.0, 20000.0)] = (
        screw_geometry.STEEL
    )
    top_mass: Annotated[float, Setting("motor and flange", "kg", 0.01, 100.0)] = 1.60
    top_distance: Annotated[
        float, Setting("their centre of mass from the screw's", "m", 0.0, 2.0)
    ] = 0.344
    travel: Annotated[float, Setting("of the nut, about the centre", "m", 0.01, 2.0)] = 0.36
    case1_top: Annotated[float, Setting("k1 of case 1", "N/m", 1e2, 1e12)] = 4e7
    case1_bottom: Annotated[float, Setting("k2 of case 1", "N/m", 1e2, 1e12)] = 5e6
    case2_top: Annotated[float, Setting("k1 of case 2", "N/m", 1e2, 1e12)] = 2e6
    case2_bottom: Annotated[float, Setting("k2 of case 2", "N/m", 1e2, 1e12)] = 2e6
    case3_top: Annotated[float, Setting("k1 of case 3", "N/m", 1e2, 1e12)] = 3e6
    case3_bottom: Annotated[float, Setting("k2 of case 3", "N/m", 1e2, 1e12)] = 3e6
    case3_ground: Annotated[float, Setting("k3 of case 3", "N/m", 1e2, 1e12)] = 3e6
    damping_top: Annotated[float, Setting("b1 of case 3", "N s/m", 0.0, 1e6)] = 0.0
    damping_bottom: Annotated[float, Setting("b2 of case 3", "N s/m", 0.0, 1e6)] = 0.0
    damping_ground: Annotated[float, Setting("b3 of case 3", "N s/m", 0.0, 1e6)] = 0.0
    case3_nut: Annotated[float, Setting("z of case 3", "m", -1.0, 1.0)] = 0.0
    wanted: Annotated[float, Setting("required natural frequency", "Hz", 1.0, 1e5)] = 500.0


class Profile(NamedTuple):
    """Inertia about the nut [kg m^2] and natural frequency [Hz], one per position of the nut."""

    inertia: np.ndarray
    frequency: np.ndarray


def profile(
    screw: Bar, z: np.ndarray, k1: float, k2: float, top_mass: float = 0.0, distance: float = 0.0
) -> Profile:
    """Evaluate eqs A.1 and A.2 without damping, with the nut at z [m].

    k1, k2 [N/m]; top_mass [kg] at `distance` [m] above the screw's centre.
    """
    inertia = _across(screw) + screw.mass * z**2 + top_mass * (distance - z) ** 2
    stiffness = k1 * (screw.half_length - z) ** 2 + k2 * (screw.half_length + z) ** 2
    return Profile(inertia, np.sqrt(stiffness / inertia) / (2.0 * math.pi))


def absorber(screw: Bar, settings: Settings) -> signal.StateSpace:
    """Return case 3: torque on the screw about the nut [Nm] -> its angular velocity [rad/s].

    States: angular velocity, velocity of the top mass, forces in k1, k2, k3. Derived from the force
    balance of both masses. Eq A.3 in our text lacks a square in its first and b1 in its second
    element, and its inertia is that about the nut only at z = 0.
    """
    up = screw.half_length - settings.case3_nut
    down = screw.half_length + settings.case3_nut
    inertia = _across(screw) + screw.mass * settings.case3_nut**2
    mass, b1, b2, b3 = (
        settings.top_mass,
        settings.damping_top,
        settings.damping_bottom,
        settings.damping_ground,
    )
    a = [
        [-(b1 * up**2 + b2 * down**2) / inertia, b1 * up / inertia,
         -up / inertia, -down / inertia, 0.0],
        [b1 * up / mass, -(b1 + b3) / mass, 1.0 / mass, 0.0, -1.0 / mass],
        [settings.case3_top * up, -settings.case3_top, 0.0, 0.0, 0.0],
        [settings.case3_bottom * down, 0.0, 0.0, 0.0, 0.0],
        [0.0, settings.case3_ground, 0.0, 0.0, 0.0],
    ]  # fmt: skip
    b = [[1.0 / inertia], [0.0], [0.0], [0.0], [0.0]]
    return signal.StateSpace(a, b, [[1.0, 0.0, 0.0, 0.0, 0.0]], [[0.0]])


def resonances(system: signal.StateSpace) -> np.ndarray:
    """Return the natural frequencies of a system's oscillating poles, ascending [rad/s]."""
    return _oscillating(linalg.eigvals(system.A))


def antiresonances(system: signal.StateSpace) -> np.ndarray:
    """Return the frequencies of its oscillating zeros, ascending [rad/s]."""
    return _oscillating(_zeros(system))


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
        return float(case1(thin, z, settings).frequency.min()) - settings.wanted

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
    """Motor and flange move with the screw; z [m]."""
    return profile(
        screw, z, settings.case1_top, settings.case1_bottom, settings.top_mass,
        settings.top_distance,
    )  # fmt: skip


def case2(screw: Bar, z: np.ndarray, settings: Settings) -> Profile:
    """Motor and flange are grounded; z [m]."""
    return profile(screw, z, settings.case2_top, settings.case2_bottom)


def run(lab: Lab, settings: Settings) -> Result:
    """Evaluate the three cases. Raises ValueError for settings out of range."""
    validated(settings)
    screws = candidates(settings.inertia_across, settings.density)
    z = positions(settings)
    profiles1 = {name: case1(screw, z, settings) for name, screw in screws.items()}
    profiles2 = {name: case2(screw, z, settings) for name, screw in screws.items()}
    systems = {name: absorber(screw, settings) for name, screw in screws.items()}
    omega = np.geomspace(1e2, 2e4, 4000)
    data = {
        "nut": z,
        "screws": np.array(list(screws)),
        "screw": np.array(settings.screw),
        "wanted": np.array(settings.wanted),
        "case1_inertia": np.array([p.inertia for p in profiles1.values()]),
        "case1_frequency": np.array([p.frequency for p in profiles1.values()]),
        "case2_frequency": np.array([p.frequency for p in profiles2.values()]),
        "omega": omega,
        "case3_response": response(systems[settings.screw], omega),
        "case3_resonances": np.array([_two(resonances(s)) for s in systems.values()]),
        "case3_antiresonance": np.array([_two(antiresonances(s))[0] for s in systems.values()]),
    }
    half_length = half_length_for(settings)
    return Result(
        NAME,
        quantities(settings, screws, data, half_length),
        settings._asdict(),
        notes(settings, screws, data, half_length),
        data,
    )


def _across(screw: Bar) -> float:
    """Return a bar's inertia about its centre across its axis [kg m^2]."""
    return screw.mass * screw.length**2 / 12.0 + screw.inertia_axis / 2.0


def _zeros(system: signal.StateSpace) -> np.ndarray:
    """Return the zeros of a system with one input and one output [rad/s]."""
    pencil = np.block([[system.A, system.B], [system.C, system.D]])
    states = np.zeros_like(pencil)
    states[: len(system.A), : len(system.A)] = np.eye(len(system.A))
    values = linalg.eigvals(pencil, states)
    return values[np.isfinite(values)]


def _oscillating(roots: np.ndarray) -> np.ndarray:
    """Return the moduli of the roots in the upper half plane, ascending, with a rounding margin."""
    scale = float(np.abs(roots).max(initial=0.0))
    return np.sort(np.abs(roots[roots.imag > 1e-6 * scale]))


def _two(values: np.ndarray) -> np.ndarray:
    """Return the first two values, NaN for missing ones: damping can remove some."""
    return np.append(values, [np.nan, np.nan])[:2]
