# SPDX-License-Identifier: Apache-2.0
"""Frequency response with a stepped sine: shared functions of the experiments of thesis 4.1."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..control.linearization import Linearization
from . import amplifier_response, static_torque
from .lab import Job, Lab, MissingResult, Part
from .linearization_fit import desired_torque
from .sine_fit import response
from .trials import Samples, TorqueTrial

SETTLE_S = 0.05
"""Excluded start of each sine [s]: many time constants of the slowest pole, 221 Hz."""


class Sweep(NamedTuple):
    """Result of a swept sine: frequencies [Hz], response, standard error of real and imaginary."""

    frequencies: np.ndarray
    values: np.ndarray
    errors: np.ndarray


class Amplifier(NamedTuple):
    """Assumed amplifier: pole [Hz], delay [s], and a note about their source."""

    pole: float
    delay: float
    note: str


def whole_cycles(frequency: float, cycles: int, shortest: float) -> float:
    """Return the time of at least `cycles` whole cycles that last at least `shortest` [s]."""
    return max(cycles, math.ceil(shortest * frequency - 1e-9)) / frequency


def torque_jobs(
    frequencies: Sequence[float], trial: TorqueTrial, cycles: int, channel: str
) -> list[Job]:
    """Return a job for each frequency [Hz], at the amplitude, linearization and rate of `trial`.

    channel: "torque", or "current" for what the current sensor shows.
    """
    reduce = {"torque": torque_part, "current": current_part}[channel]
    rate = f"-{trial.rate:g}" if trial.rate else ""
    return [
        Job(
            f"{channel}{rate}-{number:02d}",
            trial._replace(
                frequency=float(frequency),
                duration=SETTLE_S + whole_cycles(frequency, cycles, 1.0),
            ),
            reduce,
        )
        for number, frequency in enumerate(frequencies)
    ]


def torque_part(trial: TorqueTrial, samples: Samples) -> Part:
    """Return the response of torque to desired torque."""
    return _part(trial, samples, samples.torque)


def current_part(trial: TorqueTrial, samples: Samples) -> Part:
    """Return the response of the current sensor to desired torque [V/Nm]."""
    return _part(trial, samples, samples.current)


def _part(trial: TorqueTrial, samples: Samples, answer: np.ndarray) -> Part:
    kept = samples.time >= SETTLE_S
    commanded = desired_torque(trial.linearization, samples.command)
    found = response(samples.time[kept], commanded[kept], answer[kept], trial.frequency, drift=True)
    return {
        "frequency": np.array(trial.frequency),
        "value": np.array(found.value),
        "error": np.array(found.error),
    }


def sweep_of(parts: Mapping[str, Part]) -> Sweep:
    """Return the parts of a sweep as arrays, in the order of the jobs."""
    columns = ("frequency", "value", "error")
    return Sweep(*(np.array([part[name] for part in parts.values()]) for name in columns))


def known_amplifier(lab: Lab, pole: float, delay: float) -> Amplifier:
    """Return the amplifier as measured in this lab, else with this pole [Hz] and delay [s]."""
    try:
        found = lab.result(amplifier_response.NAME)
    except MissingResult:
        return Amplifier(
            pole, delay, f"Amplifier as in the settings: {pole:g} Hz, {1e6 * delay:g} us."
        )
    pole, delay = found.value("pole"), found.value("delay")
    return Amplifier(
        pole, delay, f"Amplifier as measured by {found.experiment}: {pole:.4g} Hz, "
        f"{1e6 * delay:.3g} us.",
    )  # fmt: skip


def measured_linearization(lab: Lab) -> Linearization:
    """Return the linearization measured in this lab. Raises MissingResult."""
    return static_torque.linearization_of(lab.result(static_torque.NAME))
