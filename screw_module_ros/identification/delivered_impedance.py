# SPDX-License-Identifier: Apache-2.0
"""Delivered impedance at the handle in each mode, and the module's certificate (thesis 7.1).

A firm hand moves the handle in sines of 0.5 to 30 Hz. The ratio of its force to the handle's
velocity is the impedance Z(jw) = B + j (w M - K / w), with friction as its first harmonic. On a
simulated module the hand also holds still and lets go, and a wall holds the handle. The certificate
lists apparent mass, damping and stiffness of every mode beside the commanded ones, the friction
felt, the trials at rest, and the largest stable gains with their margins.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated, NamedTuple

import numpy as np

from ..control import modes
from ..control.vertical_settings import VerticalSettings
from ..settings import Setting, validated
from . import certificate, force_error
from .force_error import with_damping
from .lab import Job, Lab, Part
from .results import Quantity, Result
from .stability import law_of
from .trials import Arm, MotionTrial, Samples

NAME = "delivered_impedance"
RESTS = {"hold": "holding", "release": "released", "wall": "wall_1e5_badly"}
"""Trials of `force_error` at rest, by their names in the certificate."""
_FIRM = Arm(0.5, 4000.0, 150.0)
_NO_GUARD = 50.0  # [N] the chatter guard must not react to a hand that shakes the handle
_CYCLES = 6
_FAST = 4.0  # [Hz] from here on the mass is found, below it the damping
_LEAST_SINE = 0.5  # share of the motion's square that is the sine; 0.9 and more on the rig


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
    """Measure every mode; write the certificate into the lab's folder.

    Data: `frequencies` [Hz] and per mode `resistance` and `reactance` [Ns/m]. The trials at rest
    need the true force of a simulated module. Raises ValueError for settings out of range,
    Cancelled, NotPossible.
    """
    validated(settings)
    kinds = [mode for mode in modes.MODE_NAMES if mode != modes.OFF]
    usual = law_of(lab)._replace(stiffness=settings.stiffness)
    jobs = {
        (mode, frequency): _job(settings, usual, mode, frequency)
        for mode in kinds
        for frequency in settings.frequencies
    }
    rests = _rests(usual, kinds) if hasattr(lab.bench, "world") else {}
    parts = lab.run(NAME, [*jobs.values(), *rests.values()])
    data: dict[str, np.ndarray] = {"frequencies": np.array(settings.frequencies)}
    quantities: list[Quantity] = []
    notes = list(_NOTES)
    for mode in kinds:
        name = modes.MODE_NAMES[mode].lower()
        found = np.array(
            [complex(parts[jobs[mode, f].name]["impedance"]) for f in settings.frequencies]
        )
        data[f"resistance_{name}"], data[f"reactance_{name}"] = found.real, found.imag
        frequencies, found, note = _followed(name, data["frequencies"], found)
        notes += note
        quantities += _fitted(name, frequencies, found, settings.stiffness)
        quantities.append(_friction(settings, usual, mode, frequencies, found))
    quantities += _at_rest(rests, parts)
    result = Result(NAME, tuple(quantities), settings._asdict(), tuple(notes), data)
    certificate.write(lab, result, settings.serial)
    return result


_NOTES = (
    "Impedance: first harmonic of force over velocity at the handle. Friction appears as a "
    "resistance, which is larger for a slower hand. Friction felt: Coulomb friction with the first "
    "harmonic of the slowest sine, without the damper's part. Mass: from the reactance at 4 Hz and "
    "above, with the commanded stiffness. The chatter guard is off, as it would react to the hand.",
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


def _job(settings: Settings, usual: VerticalSettings, mode: int, frequency: float) -> Job:
    omega = 2.0 * math.pi * frequency
    trial = MotionTrial(
        mode, with_damping(usual, mode)._replace(chatter_limit=_NO_GUARD), arm=_FIRM,
        amplitude=_amplitude(settings, frequency), omega=omega,
        duration=(2 + _CYCLES) / frequency + 0.5,
    )  # fmt: skip
    name = f"{modes.MODE_NAMES[mode].lower()}_{frequency:g}"
    return Job(name, trial, partial(reduced, frequency=frequency))


def _amplitude(settings: Settings, frequency: float) -> float:
    """Return the amplitude of the hand's sine [m]."""
    omega = 2.0 * math.pi * frequency
    return min(0.04, settings.speed / omega, settings.acceleration / omega**2)


def _rests(usual: VerticalSettings, kinds: list[int]) -> dict[tuple[str, str], Job]:
    """Return the trials at rest by names of the mode and the trial."""
    return {
        (modes.MODE_NAMES[mode].lower(), rest): force_error.job(
            force_error.case_of(case), mode, with_damping(usual, mode)
        )
        for mode in kinds
        for rest, case in RESTS.items()
    }


def _at_rest(rests: dict[tuple[str, str], Job], parts: dict[str, Part]) -> list[Quantity]:
    found = []
    for (name, rest), job in rests.items():
        rms, travel = (float(parts[job.name][key]) for key in ("rms", "travel"))
        text = f"{force_error.case_of(RESTS[rest]).text}, {name}"
        found += [
            Quantity(f"{rest}_{name}", rms, math.nan, "N", f"rms force error, {text}"),
            Quantity(f"{rest}_travel_{name}", travel, math.nan, "m", f"moves in a second, {text}"),
        ]
    return found


def friction_felt(resistance: float, damping: float, speed: float) -> float:
    """Return the Coulomb friction [N] equivalent to a resistance [Ns/m] at the first harmonic.

    damping: the commanded part of the resistance [Ns/m]; speed: amplitude of the velocity [m/s]. A
    force F with the sign of the velocity has the first harmonic 4 F / pi.
    """
    return math.pi / 4.0 * (resistance - damping) * speed


def _friction(
    settings: Settings, usual: VerticalSettings, mode: int, frequencies: np.ndarray, z: np.ndarray
) -> Quantity:
    slow = int(np.argmin(frequencies))
    frequency = float(frequencies[slow])
    speed = 2.0 * math.pi * frequency * _amplitude(settings, frequency)
    felt = friction_felt(float(z.real[slow]), with_damping(usual, mode).damping, speed)
    name = modes.MODE_NAMES[mode].lower()
    return Quantity(f"friction_{name}", felt, math.nan, "N",
                    f"friction felt at {frequency:g} Hz, {name}")  # fmt: skip


def reduced(trial: MotionTrial, samples: Samples, frequency: float) -> Part:
    """Return force over velocity of the handle [Ns/m] at a frequency [Hz], over whole cycles.

    On a real module: the transducer's force over the nut's velocity. NaN if the handle did not
    follow the sine: force over a motion of other frequencies is no impedance.
    """
    period = samples.time[1] - samples.time[0]
    count = round(_CYCLES / frequency / period)
    turning = np.exp(-2j * math.pi * frequency * samples.time[-count:])
    force = samples.force if samples.true_force is None else samples.true_force
    position = samples.position if samples.handle is None else samples.handle
    swing = position[-count:] - position[-count:].mean()
    moved = (turning * swing).sum()
    if not 2.0 * abs(moved) ** 2 >= _LEAST_SINE * len(swing) * (swing**2).sum() > 0.0:
        return {"impedance": np.array(complex(math.nan, math.nan))}
    velocity = 2j * math.pi * frequency * moved
    return {"impedance": np.array((turning * force[-count:]).sum() / velocity)}


def _fitted(name: str, frequencies: np.ndarray, z: np.ndarray, stiffness: float) -> list[Quantity]:
    omega = 2.0 * math.pi * frequencies
    fast = frequencies >= _FAST
    masses = (z.imag[fast] + stiffness / omega[fast]) / omega[fast]
    slow = int(np.argmin(frequencies))
    return [
        Quantity(f"mass_{name}", float(np.median(masses)), float(np.ptp(masses) / 2.0), "kg",
                 f"apparent mass above 4 Hz, {name}"),
        Quantity(f"damping_{name}", float(np.median(z.real[~fast])), math.nan, "Ns/m",
                 f"resistance below 4 Hz, friction included, {name}"),
        Quantity(f"stiffness_{name}", float(-z.imag[slow] * omega[slow]), math.nan, "N/m",
                 f"stiffness at {frequencies[slow]:g} Hz, inertia included, {name}"),
    ]  # fmt: skip
