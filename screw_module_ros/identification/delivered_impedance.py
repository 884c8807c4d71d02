# SPDX-License-Identifier: Apache-2.0
"""Delivered impedance at the handle in each mode, and the module's gain limits (a tool
as 7.1 asks for one; ours).

A firm hand moves the handle in sines of 0.5 to 30 Hz. The ratio of its force to the handle's
velocity is the impedance Z(jw) = B + j (w M - K / w), with friction as its first harmonic. On a
simulated module the hand also holds still and lets go, and a wall holds the handle. The file
lists apparent mass, damping and stiffness of every mode beside the commanded ones, the friction
felt, the trials at rest, and the largest stable gains with their margins.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from ..control.laws import variants
from ..control.vertical_settings import VerticalSettings
from ..settings import Setting
from . import calibration, force_error
from .figures import COLOURS, DESIRED, error_map, panels
from .force_error import with_damping
from .force_metric import apparent_mass, first_harmonic, friction_felt, sine
from .lab import Lab, Part
from .results import HUMAN_ARM, Drawn, Experiment, Quantity, Result
from .stability import law_of
from .trials import FIRM, TRUTH, MotionTrial, Samples

NAME = "delivered_impedance"
RESTS = {"hold": "holding", "release": "released", "wall": "wall_1e5_badly"}
"""Trials of `force_error` at rest, by their names in the file."""
_NO_GUARD = 50.0  # [N] the chatter guard must not react to a hand that shakes the handle
_FAST = 4.0  # [Hz] from here on the mass is found, below it the damping


class Settings(NamedTuple):
    """Sines of the hand, and the commanded spring."""

    frequencies: Annotated[tuple[float, ...], Setting("of the sines", "Hz", 0.1, 100.0)] = (
        0.5, 1.0, 2.0, 4.0, 8.0, 15.0, 30.0,
    )  # fmt: skip
    speed: Annotated[float, Setting("peak speed of the hand's sine", "m/s", 0.01, 0.3)] = 0.12
    acceleration: Annotated[
        float, Setting("peak acceleration of the hand's sine", "m/s^2", 0.1, 20.0)
    ] = 3.0
    stiffness: Annotated[float, Setting("commanded stiffness", "N/m", 0.0, 5000.0)] = 100.0
    serial: Annotated[str, Setting("serial number of the module")] = "SIM-0001"


def run(lab: Lab, settings: Settings) -> Result:
    """Measure every mode; write the gain limits into the lab's folder.

    Data: `frequencies` [Hz] and per mode `resistance` and `reactance` [Ns/m]. The trials at rest
    need the true force of a simulated module. Raises ValueError, Cancelled, NotPossible.
    """
    serial = calibration.own_serial(lab, settings.serial)
    usual = law_of(lab)._replace(stiffness=settings.stiffness)
    named = {mode: variant.name.lower() for mode, variant in variants(lab.stand.laws).items()}
    trials = {
        f"{name}_{frequency:g}": _trial(settings, usual, mode, frequency)
        for mode, name in named.items()
        for frequency in settings.frequencies
    }
    parts = lab.record(NAME, trials, reduced)
    data: dict[str, np.ndarray] = {"frequencies": np.array(settings.frequencies)}
    quantities: list[Quantity] = []
    notes = list(_NOTES)
    for name in named.values():
        found = np.array(
            [complex(parts[f"{name}_{f:g}"]["impedance"]) for f in settings.frequencies]
        )
        data[f"resistance_{name}"], data[f"reactance_{name}"] = found.real, found.imag
        frequencies, found, note = _followed(name, data["frequencies"], found)
        notes += note
        slowest = trials[f"{name}_{frequencies.min():g}"]
        quantities += _fitted(slowest, settings.stiffness, name, frequencies, found)
        if (negative := frequencies[found.real < 0.0]).size:
            hertz = ", ".join(f"{f:g}" for f in negative)
            notes.append(f"In {name} the resistance is negative at {hertz} Hz: not passive there.")
    unsure = [q.name for q in quantities if abs(q.uncertainty) >= abs(q.value)]
    quantities = [q for q in quantities if q.name not in unsure]
    if unsure:
        notes.append(f"Not determined, left out: {', '.join(unsure)}.")
    if TRUTH in lab.stand.offers:
        quantities += _at_rest(lab, usual, named)
    result = Result(NAME, tuple(quantities), settings._asdict(), tuple(notes), data)
    calibration.write_gain_limits(lab, result, serial)
    return result


_NOTES = (
    "Impedance: first harmonic of force over velocity at the handle. Friction appears as a "
    "resistance, which is larger for a slower hand. Friction felt: Coulomb friction with the first "
    "harmonic of the slowest sine, without the damper's part. Mass: from the reactance at 4 Hz and "
    "above, with the commanded stiffness. The chatter guard is off, as it would react to the hand.",
    "Compensated friction is taken from the passivity margin: friction that the law removes no "
    "longer damps an oscillation.",
)


def _followed(
    name: str, frequencies: np.ndarray, z: np.ndarray
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Return the frequencies whose sine the handle followed [Hz], impedances there, and a note.

    Raises ValueError if none is left on a side of 4 Hz, which the fits need.
    """
    there = np.isfinite(z)
    left = ", ".join(f"{f:g}" for f in frequencies[~there])
    for side, text in ((frequencies < _FAST, "below"), (frequencies >= _FAST, "from")):
        if side.any() and not (there & side).any():
            raise ValueError(
                f"in {name} the handle followed no sine {text} {_FAST:g} Hz (not those of {left} "
                "Hz): drive it with a motor, or choose other frequencies"
            )
    said = [f"The handle did not follow {left} Hz in {name}: left out."] if left else []
    return frequencies[there], z[there], said


def _trial(
    settings: Settings, usual: VerticalSettings, mode: int, frequency: float
) -> MotionTrial:
    amplitude, omega, seconds = sine(frequency, settings.speed, settings.acceleration)
    return MotionTrial(
        mode, with_damping(usual, mode)._replace(chatter_limit=_NO_GUARD), arm=FIRM,
        amplitude=amplitude, omega=omega, duration=seconds,
    )  # fmt: skip


def _at_rest(lab: Lab, usual: VerticalSettings, named: dict[int, str]) -> list[Quantity]:
    """Return force error and travel of the trials at rest in each mode; named: mode -> name."""
    trials = {
        force_error.name_of(mode, case, named): force_error.trial_of(
            case, mode, with_damping(usual, mode)
        )
        for mode in named
        for case in RESTS.values()
    }
    parts = lab.record(NAME, trials, force_error.reduced)
    found = []
    for name in named.values():
        for rest, case in RESTS.items():
            part, text = parts[f"{name}_{case}"], f"{force_error.CASES[case].text}, {name}"
            found += [
                Quantity(f"{rest}_{name}", float(part["rms"]), math.nan, "N",
                         f"rms force error, {text}"),
                Quantity(f"{rest}_travel_{name}", float(part["travel"]), math.nan, "m",
                         f"moves in a second, {text}"),
            ]  # fmt: skip
    return found


def reduced(trial: MotionTrial, samples: Samples) -> Part:
    """Return force over velocity of the handle [Ns/m] at the sine's frequency, over whole cycles.

    On a real module: the transducer's force over the nut's velocity. NaN if the handle did not
    follow the sine: force over a motion of other frequencies is no impedance.
    """
    position, _, force = samples.felt
    found = first_harmonic(samples.time, position, force, trial.omega)
    return {"impedance": np.array(found)}


def _fitted(
    trial: MotionTrial, stiffness: float, name: str, frequencies: np.ndarray, z: np.ndarray
) -> list[Quantity]:
    """Return mass, damping, stiffness, friction; uncertainties: half of the range over frequencies.

    That of the stiffness is what the apparent mass takes from it. trial: with the slowest sine.
    """
    omega, slow = 2.0 * math.pi * frequencies, int(np.argmin(frequencies))
    fast = frequencies >= _FAST
    masses = apparent_mass(z.imag, frequencies, stiffness)[fast]
    mass, resistance = float(np.median(masses)), z.real[~fast]
    at, speed = f"at {frequencies[slow]:g} Hz", trial.omega * trial.amplitude
    friction = friction_felt(float(z.real[slow]), trial.settings.damping, speed)
    return [
        Quantity(f"mass_{name}", mass, float(np.ptp(masses) / 2.0), "kg",
                 f"apparent mass above 4 Hz, {name}"),
        Quantity(f"damping_{name}", float(np.median(resistance)),
                 float(np.ptp(resistance) / 2.0) if len(resistance) > 1 else math.nan, "Ns/m",
                 f"resistance below 4 Hz, friction included, {name}"),
        Quantity(f"stiffness_{name}", float(-z.imag[slow] * omega[slow]),
                 abs(mass) * float(omega[slow]) ** 2, "N/m",
                 f"stiffness {at}, inertia included, {name}"),
        Quantity(f"friction_{name}", friction, math.nan, "N", f"friction felt {at}, {name}"),
    ]  # fmt: skip


def draw(result: Result) -> Drawn:
    """Draw the impedance at the handle over the frequency, and the errors at rest."""
    frequencies = result.data["frequencies"]
    found = [key.partition("resistance_") for key in result.data]
    names = [name for before, what, name in found if what and not before]
    labels = {name: name.replace("_", " ") for name in names}
    figure, (left, right) = panels(1, 2, (9.0, 4.2))
    for (name, label), colour in zip(labels.items(), COLOURS, strict=False):
        line = {"marker": "o", "markersize": 3.0, "color": colour}
        mass = apparent_mass(
            result.data[f"reactance_{name}"], frequencies, result.settings["stiffness"]
        )
        left.plot(frequencies, result.data[f"resistance_{name}"], **line, label=label)
        right.plot(frequencies, mass, **line)
    for axes, linear in ((left, 10.0), (right, 5.0)):
        axes.set(xscale="log", xlabel="frequency [Hz]")
        axes.set_yscale("symlog", linthresh=linear)
        axes.xaxis.set_major_formatter("{x:g}")
        axes.axhline(0.0, color=DESIRED, linewidth=0.8)
    low = min(left.get_ylim()[0], -20.0)
    left.set_ylim(bottom=low)
    left.axhspan(low, 0.0, color="#f3d9d0", zorder=0, label="negative: the handle gives energy")
    left.set_title("Resistance Re Z, friction included [Ns/m]")
    right.set_title("Apparent mass from Im Z, spring taken off [kg]")
    figure.legend(loc="outside lower center", ncols=3)
    figures, known = {"impedance": figure}, {quantity.name for quantity in result.quantities}
    if rests := [rest for rest in RESTS if f"{rest}_{names[0]}" in known]:
        rows = {
            label: [result.value(f"{rest}_{name}") for rest in rests]
            for name, label in labels.items()
        }
        figures["at rest"] = error_map(rows, rests, "At rest")
    return figures


EXPERIMENT = Experiment(
    NAME, "delivered impedance at the handle in each mode, and the module's gain limits",
    Settings, run, draw, HUMAN_ARM, ("stability",),
)  # fmt: skip
