# SPDX-License-Identifier: Apache-2.0
"""Delivered impedance of the plane with and without force feedback (thesis appendix D).

As `delivered_impedance` does for the vertical: a hand moves the handle in sines, here along four
directions, and the ratio of its force to the handle's velocity along the direction is the impedance
there. The law is the studied one with its guard, which takes the gain of the feedback back where it
oscillates; what is left of it is told. That depends on hand and structure, so a firm hand and the
arm of thesis 6.4.3 do it, and the arm on a stiff structure too. Appendix D asks for inertia and
friction at the handle, and for an impedance that is mainly viscous up to 7 Hz.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
from matplotlib.ticker import NullLocator

from ..control.planar_settings import STUDIED_GAIN, PlanarSettings
from ..plant.patient import HandPath
from ..settings import Setting
from .figures import COLOURS, DESIRED, panels
from .force_metric import CYCLES, apparent_mass, first_harmonic, friction_felt, sine
from .lab import Lab, Part
from .results import HUMAN_ARM, Drawn, Experiment, Quantity, Result
from .trials import FIRM, Arm, PlanarTrial, Samples

NAME = "planar_impedance"
DIRECTIONS = {f"{angle} degrees": math.radians(angle) for angle in (0, 45, 90, 135)}
"""From +x counter-clockwise [rad]."""
HAND_HZ = 2.0
"""Up to here a hand moves in therapy, and the inertia counts [Hz]."""
STIFF = 1e6
"""The stiffest structure that a rig is drawn with [N/m]."""


class Case(NamedTuple):
    """One way to measure. text; kind: none or feedback; arm; structure: 0 = the rig's [N/m]."""

    text: str
    kind: str
    arm: Arm
    structure: float = 0.0


CASES = {
    "none": Case("without force feedback", "none", FIRM),
    "feedback": Case("with force feedback, an arm of 3 kg", "feedback", Arm()),
    "firm": Case("with force feedback, a firm hand", "feedback", FIRM),
    "stiff": Case(f"with force feedback, an arm of 3 kg, a structure of {STIFF:g} N/m", "feedback",
                  Arm(), STIFF),
}  # fmt: skip
"""A firm hand follows every sine, an arm those of a hand's motion."""


class Settings(NamedTuple):
    """Sines of the hand, and the commanded spring and damper."""

    frequencies: Annotated[tuple[float, ...], Setting("of the sines", "Hz", 0.1, 20.0)] = (
        0.5, 1.0, 2.0, 4.0, 7.0,
    )  # fmt: skip
    speed: Annotated[float, Setting("peak speed of the hand's sine", "m/s", 0.01, 0.3)] = 0.12
    acceleration: Annotated[
        float, Setting("peak acceleration of the hand's sine", "m/s^2", 0.1, 20.0)
    ] = 3.0
    stiffness: Annotated[float, Setting("commanded stiffness", "N/m", 0.0, 2000.0)] = 100.0
    damping: Annotated[float, Setting("commanded damper", "Ns/m", 0.0, 200.0)] = 10.0


def run(lab: Lab, settings: Settings) -> Result:
    """Measure every direction in every case.

    Data: `frequencies` [Hz] and per case `resistance` and `reactance` [Ns/m], one row for each of
    `DIRECTIONS`, NaN where not measured. Raises ValueError without a frequency of a hand, or if the
    handle follows none, Cancelled, NotPossible.
    """
    if not min(settings.frequencies, default=math.inf) <= HAND_HZ:
        raise ValueError(f"frequencies: none is {HAND_HZ:g} Hz or less, where the inertia counts")
    trials = {
        f"{case}_{name.split()[0]}_{frequency:g}": _trial(settings, case, direction, frequency)
        for case in CASES
        for name, direction in DIRECTIONS.items()
        for frequency in settings.frequencies
        if CASES[case].arm == FIRM or frequency <= HAND_HZ
    }
    parts = lab.record(NAME, trials, reduced)
    data = {"frequencies": np.array(settings.frequencies)}
    quantities: list[Quantity] = []
    for case in CASES:
        found = np.array([
            [_found(parts.get(f"{case}_{name.split()[0]}_{frequency:g}"))
             for frequency in settings.frequencies]
            for name in DIRECTIONS
        ])  # fmt: skip
        z, speeds, shares = found[..., 0], found[..., 1].real, found[..., 2].real
        data[f"resistance_{case}"], data[f"reactance_{case}"] = z.real, z.imag
        quantities += _fitted(settings, case, z, speeds, shares)
    return Result(NAME, tuple(quantities), settings._asdict(), _NOTES, data)


def _found(part: Part | None) -> list[complex]:
    """Return impedance, speed and share of a trial, NaN where there was none."""
    if part is None:
        return [complex(math.nan, math.nan)] * 3
    return [complex(part[name]) for name in ("impedance", "speed", "share")]


_NOTES = (
    "Impedance: first harmonic of the true force over the velocity of the handle, both along the "
    f"direction of the motion. Inertia: mean at {HAND_HZ:g} Hz and below, with the commanded "
    "stiffness. Friction: Coulomb friction with the first harmonic of the slowest sine, without "
    "the damper's part. Mainly viscous: the resistance is larger than what inertia leaves of the "
    "reactance without the spring, in every direction.",
    "At 4 Hz and above the resistance has two more parts. Across the direction arm and module "
    "swing on the hand's 4000 N/m, which takes energy from the motion along it. With feedback the "
    "guard takes a fast sine for an oscillation: a damper of its own, and less gain.",
    "In the figure: 0, 45, 90 and 135 degrees solid, dashed, dotted, and dotted and dashed.",
    "500 samples per second and 0.7 ms from a sample to its torque, as in `study --plane`.",
)


def _trial(settings: Settings, case: str, direction: float, frequency: float) -> PlanarTrial:
    amplitude, omega, seconds = sine(frequency, settings.speed, settings.acceleration)
    _, kind, arm, structure = CASES[case]
    law = PlanarSettings(
        damping=settings.damping, force_gain=STUDIED_GAIN if kind == "feedback" else 0.0
    )
    return PlanarTrial(
        law._replace(stiffness=settings.stiffness), arm=arm, direction=direction,
        structure_stiffness=structure,
        path=HandPath(0.0, 0.0, 0.0, 0.0, amplitude, omega, 0.0),
        duration=seconds,
    )  # fmt: skip


def reduced(trial: PlanarTrial, samples: Samples) -> Part:
    """Return the impedance along the direction [Ns/m], the speed's amplitude and the gain's share.

    All over the last cycles: the hand begins its sine with a jolt, and the guard acts on that.
    """
    along = np.array([math.cos(trial.direction), math.sin(trial.direction)])
    position, velocity, force = samples.felt
    found = first_harmonic(samples.time, position @ along, force @ along, trial.path.omega)
    last = samples.time >= samples.time[-1] - 2.0 * math.pi * CYCLES / trial.path.omega
    return {
        "impedance": np.array(found),
        "speed": np.sqrt(2.0 * np.mean((velocity[last] @ along) ** 2)),
        "share": np.array(samples.share[last].mean()),
    }


def _fitted(
    settings: Settings, case: str, z: np.ndarray, speeds: np.ndarray, shares: np.ndarray
) -> list[Quantity]:
    """Return inertia, friction and, of a firm hand, the viscous range of a case.

    z, speeds, shares: impedances [Ns/m], amplitudes of the velocity [m/s] and mean shares of the
    gain, by direction and frequency.
    """
    frequencies = np.array(settings.frequencies)
    handled = frequencies <= HAND_HZ
    slow = int(np.argmin(frequencies))
    masses = apparent_mass(z.imag, frequencies, settings.stiffness)
    if not np.isfinite(masses[:, handled]).any(axis=1).all():
        raise ValueError(f"{CASES[case].text}: the handle followed no sine in some direction")
    inertia = np.nanmean(masses[:, handled], axis=1)
    friction = np.array([
        friction_felt(float(one), settings.damping, float(speed))
        for one, speed in zip(z.real[:, slow], speeds[:, slow], strict=True)
    ])  # fmt: skip
    inertial = np.abs(2.0 * np.pi * frequencies * masses)
    viscous = (z.real > inertial).all(axis=0)
    order = np.argsort(frequencies)
    held = np.logical_and.accumulate(viscous[order])
    upto = float(frequencies[order][held].max()) if held.any() else 0.0
    text = CASES[case].text

    def of(name: str, value: float, unit: str, what: str) -> Quantity:
        return Quantity(f"{name}_{case}", float(value), math.nan, unit, f"{what}, {text}")

    found = [
        of("inertia_most", inertia.max(), "kg", "inertia in the heaviest direction"),
        of("inertia_least", inertia.min(), "kg", "inertia in the lightest direction"),
        of("friction_most", friction.max(), "N", "friction felt in the stiffest direction"),
        of("friction_least", friction.min(), "N", "friction felt in the easiest direction"),
        of("share", np.nanmin(shares[:, handled]), "",
           f"least share of the force gain that the guard left at {HAND_HZ:g} Hz and below"),
    ]  # fmt: skip
    if CASES[case].arm == FIRM:
        what = "largest frequency of the sines up to which it is viscous"
        found.append(of("viscous_to", upto, "Hz", what))
    return found


def draw(result: Result) -> Drawn:
    """Draw resistance and inertia of every direction over the frequency."""
    frequencies = result.data["frequencies"]
    figure, (left, right) = panels(1, 2, (9.0, 4.6))
    for (case, (text, *_)), colour in zip(CASES.items(), COLOURS, strict=False):
        resistance, reactance = result.data[f"resistance_{case}"], result.data[f"reactance_{case}"]
        masses = apparent_mass(reactance, frequencies, result.settings["stiffness"])
        for number, dash in enumerate(("-", "--", ":", "-.")):
            line = {"marker": "o", "markersize": 3.0, "color": colour, "linestyle": dash}
            left.plot(frequencies, resistance[number], **line, label="" if number else text)
            right.plot(frequencies, masses[number], **line)
    for axes in (left, right):
        axes.set(xscale="log", xlabel="frequency [Hz]")
        axes.set_xticks(frequencies, [f"{one:g}" for one in frequencies])
        axes.xaxis.set_minor_locator(NullLocator())
    left.axhline(result.settings["damping"], color=DESIRED, linewidth=0.8)
    right.axhline(0.0, color=DESIRED, linewidth=0.8)
    left.set_title("Resistance Re Z, friction included [Ns/m]")
    right.set_title("Inertia from Im Z, spring taken off [kg]")
    figure.legend(loc="outside lower center", ncols=1)
    return {"planar impedance": figure}


EXPERIMENT = Experiment(
    NAME, "delivered impedance of the plane: inertia and friction at the handle (appendix D)",
    Settings, run, draw, HUMAN_ARM,
)  # fmt: skip
