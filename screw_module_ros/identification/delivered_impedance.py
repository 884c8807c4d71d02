# SPDX-License-Identifier: Apache-2.0
"""Impedance that the handle delivers in each mode, and the module's certificate (thesis 7.1).

A firm hand moves the handle in one sine after the other, 0.5 to 30 Hz, and the ratio of its force
to the handle's velocity is what it feels there, Z(jw) = B + j (w M - K / w): friction included, as
its first harmonic. The certificate puts apparent mass, damping and stiffness of every mode beside
what was asked for, the friction felt, and the largest stable gains with their margins.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated, NamedTuple

import numpy as np
import yaml

from ..control import modes
from ..control.vertical_settings import VerticalSettings
from ..settings import Setting, validated
from . import stability
from .force_error import with_damping
from .lab import Job, Lab, MissingResult, Part
from .results import Quantity, Result
from .trials import Arm, MotionTrial, Samples

NAME = "delivered_impedance"
FILE = "module_certificate.yaml"
_FIRM = Arm(0.5, 4000.0, 150.0)
_NO_GUARD = 50.0  # [N] a hand that shakes the handle on purpose is not to be taken for chatter
_CYCLES = 6


class Settings(NamedTuple):
    """What the hand does."""

    frequencies: Annotated[tuple[float, ...], Setting("of the sines", "Hz", 0.1, 100.0)] = (
        0.5, 1.0, 2.0, 4.0, 8.0, 15.0, 30.0,
    )  # fmt: skip
    speed: Annotated[float, Setting("largest of the hand's sine", "m/s", 0.01, 0.3)] = 0.12
    acceleration: Annotated[float, Setting("largest of it", "m/s^2", 0.1, 20.0)] = 3.0
    stiffness: Annotated[float, Setting("asked of the law", "N/m", 0.0, 5000.0)] = 100.0


def run(lab: Lab, settings: Settings) -> Result:
    """Measure every mode; write the certificate into the lab's folder.

    Data: `frequencies` [Hz] and per mode `resistance` and `reactance` [Ns/m]. Raises ValueError for
    settings out of range, Cancelled, NotPossible.
    """
    validated(settings)
    kinds = [mode for mode in modes.MODE_NAMES if mode != modes.OFF]
    jobs = {
        (mode, frequency): _job(settings, mode, frequency)
        for mode in kinds
        for frequency in settings.frequencies
    }
    parts = lab.run(NAME, list(jobs.values()))
    data: dict[str, np.ndarray] = {"frequencies": np.array(settings.frequencies)}
    quantities: list[Quantity] = []
    for mode in kinds:
        name = modes.MODE_NAMES[mode].lower()
        found = np.array(
            [complex(parts[jobs[mode, f].name]["impedance"]) for f in settings.frequencies]
        )
        data[f"resistance_{name}"], data[f"reactance_{name}"] = found.real, found.imag
        quantities += _fitted(name, data["frequencies"], found, settings.stiffness)
    result = Result(NAME, tuple(quantities), settings._asdict(), _NOTES, data)
    _write(lab, result)
    return result


_NOTES = (
    "Force over velocity at the handle, first harmonic; friction shows as resistance, the more the "
    "slower the hand. Mass: from the reactance at 4 Hz and above, with the stiffness asked for. "
    "The chatter guard is off: it would take this for chatter.",
)


def _job(settings: Settings, mode: int, frequency: float) -> Job:
    omega = 2.0 * math.pi * frequency
    amplitude = min(0.04, settings.speed / omega, settings.acceleration / omega**2)
    law = VerticalSettings(stiffness=settings.stiffness, chatter_limit=_NO_GUARD)
    trial = MotionTrial(
        mode, with_damping(law, mode), arm=_FIRM, amplitude=amplitude, omega=omega,
        duration=(2 + _CYCLES) / frequency + 0.5,
    )  # fmt: skip
    name = f"{modes.MODE_NAMES[mode].lower()}_{frequency:g}"
    return Job(name, trial, partial(reduced, frequency=frequency))


def reduced(trial: MotionTrial, samples: Samples, frequency: float) -> Part:
    """Return force over velocity of the handle [Ns/m] at a frequency [Hz], over whole cycles.

    Where no truth is to be had, of the nut and by the transducer.
    """
    period = samples.time[1] - samples.time[0]
    count = round(_CYCLES / frequency / period)
    turning = np.exp(-2j * math.pi * frequency * samples.time[-count:])
    force = samples.force if samples.true_force is None else samples.true_force
    position = samples.position if samples.handle is None else samples.handle
    moved = (turning * position[-count:]).sum() * 2j * math.pi * frequency
    return {"impedance": np.array((turning * force[-count:]).sum() / moved)}


def _fitted(name: str, frequencies: np.ndarray, z: np.ndarray, stiffness: float) -> list[Quantity]:
    omega = 2.0 * math.pi * frequencies
    fast = frequencies >= 4.0
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


def _write(lab: Lab, result: Result) -> None:
    """Write the certificate; gains are in it where `stability` was run."""
    text = {
        "format": "screw_module_ros/certificate",
        "version": 1,
        "bench": lab.bench.name,
        "asked_for": {"stiffness_N_m": result.settings["stiffness"]},
        "delivered": {q.name: {"value": round(q.value, 4), "unit": q.unit, "what": q.text}
                      for q in result.quantities},
    }  # fmt: skip
    try:
        gains = lab.result(stability.NAME)
    except MissingResult:
        gains = None
    if gains is not None:
        defaults = VerticalSettings()
        own = {"feedback": defaults.force_gain, "observer": defaults.observer_gain}
        text["largest_gains"] = {
            q.name: {"gain": round(q.value, 2),
                     "margin": round(q.value / own[q.name.split("_")[0]], 2), "what": q.text}
            for q in gains.quantities if q.name.split("_")[0] in own
        }  # fmt: skip
    path = lab.folder / FILE
    path.write_text(yaml.safe_dump(text, sort_keys=False, allow_unicode=True), encoding="utf-8")
