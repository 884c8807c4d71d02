# SPDX-License-Identifier: Apache-2.0
"""Force against position for every controller mode and gain (thesis chapter 6).

The hand moves the handle slowly through the commanded spring. The offset is its force minus the
spring's. Figures 6-1, 6-2 (PD), 6-5 (negative damping), 6-8, 6-9 (friction model), 6-10 (force
feedback), 6-12, 6-13 (the thesis's simulation).
"""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated, NamedTuple

import numpy as np

from ..control import modes
from ..control.vertical_settings import VerticalSettings
from ..settings import Setting
from .force_position import Spring, offsets
from .lab import Job, Lab, Part, by_name
from .results import Quantity, Result
from .trials import Arm, MotionTrial, Samples

NAME = "force_position"
_EVERY = 8  # samples to one point of a curve


class Curve(NamedTuple):
    """One curve: its name, the thesis's figure, the law's mode and gains, the hand.

    stiffness [N/m], damping [Ns/m], gain: Kf.
    """

    name: str
    figure: str
    mode: int
    stiffness: float = 100.0
    damping: float = 0.0
    gain: float = 0.0
    firm: bool = False
    simulated: bool = False


CURVES = (
    Curve("pd_100", "6-1", modes.IMPEDANCE),
    Curve("pd_1000", "6-2", modes.IMPEDANCE, stiffness=1000.0, firm=True),
    Curve("damping_-25", "6-5", modes.IMPEDANCE, damping=-25.0),
    Curve("damping_-50", "6-5", modes.IMPEDANCE, damping=-50.0),
    Curve("friction_model", "6-8", modes.FRICTION_COMPENSATION),
    Curve("feedback_1", "", modes.FORCE_FEEDBACK, gain=1.0),
    Curve("feedback_2", "", modes.FORCE_FEEDBACK, gain=2.0),
    Curve("feedback_5", "6-10", modes.FORCE_FEEDBACK, gain=5.0),
    Curve("feedback_8", "", modes.FORCE_FEEDBACK, gain=8.0),
    Curve("combined_5", "6.4.4", modes.COMBINED, gain=5.0),
    Curve("simulated_pd", "6-12", modes.IMPEDANCE, simulated=True),
    Curve("simulated_feedback_5", "6-13", modes.FORCE_FEEDBACK, gain=5.0, simulated=True),
)


class Settings(NamedTuple):
    """Motion of the hand, and selection of the curves."""

    centre: Annotated[float, Setting("centre of the spring", "m", 0.1, 0.25)] = 0.18
    amplitude: Annotated[float, Setting("of the virtual hand", "m", 0.02, 0.15)] = 0.14
    omega: Annotated[float, Setting("of the hand: slowly", "rad/s", 0.05, 3.0)] = 0.5
    cycles: Annotated[float, Setting("of the hand per curve", "", 1.0, 20.0)] = 2.0
    firm_stiffness: Annotated[
        float, Setting("of the hand against the spring of 1000 N/m", "N/m", 300.0, 5000.0)
    ] = 2000.0
    curves: Annotated[
        tuple[str, ...], Setting("names of the curves to measure", choices=())
    ] = tuple(curve.name for curve in CURVES)


def run(lab: Lab, settings: Settings) -> Result:
    """Measure the curves. Raises ValueError for an unknown curve, Cancelled, NotPossible."""
    chosen = [by_name("curves", CURVES, name) for name in settings.curves]
    jobs = [
        Job(curve.name, trial_of(curve, settings), partial(reduced, stiffness=curve.stiffness))
        for curve in chosen
    ]
    parts = lab.run(NAME, jobs)
    quantities = []
    for curve in chosen:
        quantities += _quantities(curve, parts[curve.name])
    data = {
        f"{curve.name}/{name}": parts[curve.name][name]
        for curve in chosen
        for name in ("position", "velocity", "force")
    }
    return Result(NAME, tuple(quantities), settings._asdict(), _notes(chosen), data)


def trial_of(curve: Curve, settings: Settings) -> MotionTrial:
    """Return the trial of one curve; the simulated ones move as the thesis's simulation (6.4.3)."""
    law = VerticalSettings(
        stiffness=curve.stiffness, damping=curve.damping, force_gain=curve.gain
    )
    omega = 0.8 if curve.simulated else settings.omega
    return MotionTrial(
        curve.mode,
        law,
        arm=Arm(stiffness=settings.firm_stiffness) if curve.firm else Arm(),
        centre=settings.centre,
        amplitude=0.15 if curve.simulated else settings.amplitude * (0.8 if curve.firm else 1.0),
        omega=omega,
        duration=settings.cycles * 2.0 * math.pi / omega,
    )


def reduced(trial: MotionTrial, samples: Samples, stiffness: float) -> Part:
    """Return every eighth sample of the curve, and the offsets from the spring over all samples.

    Samples at which the law's force limits act (the bulge of fig 6-2) have no offset.
    """
    spring = Spring(stiffness, trial.centre)
    free = _free(trial, samples, spring)
    found = offsets(samples.position[free], samples.velocity[free], samples.force[free], spring)
    return {
        "position": samples.position[::_EVERY],
        "velocity": samples.velocity[::_EVERY],
        "force": samples.force[::_EVERY],
        "offset": np.array(found.mean),
        "up": np.array(found.bias_up),
        "down": np.array(found.bias_down),
        "spread": np.array(_spread(samples.position[free], samples.force[free], spring)),
        "largest": np.array(np.abs(samples.velocity).max()),
    }


def _free(trial: MotionTrial, samples: Samples, spring: Spring) -> np.ndarray:
    """Return the mask of the samples at which spring and gravity are within the force limits."""
    law = trial.settings
    pull = -spring.stiffness * (samples.position - spring.centre) + law.gravity
    return (pull > -law.force_down) & (pull < law.force_up)


def _spread(position: np.ndarray, force: np.ndarray, spring: Spring) -> float:
    """Return the standard error of the mean offset [N], from its scatter over eight parts."""
    beyond = np.abs(force - spring.stiffness * (position - spring.centre))
    parts = [part.mean() for part in np.array_split(beyond, 8)]
    return float(np.std(parts) / math.sqrt(len(parts)))


def _quantities(curve: Curve, part: Part) -> list[Quantity]:
    label = f"{curve.name}, fig {curve.figure}" if curve.figure else curve.name
    return [
        Quantity(
            f"offset_{curve.name}",
            float(part["offset"]),
            float(part["spread"]),
            "N",
            f"mean offset from the spring in motion ({label})",
        )
    ]


def _notes(chosen: list[Curve]) -> tuple[str, ...]:
    if not any(curve.simulated for curve in chosen):
        return ()
    return (
        "Figures 6-12 and 6-13 use the thesis's arm and virtual trajectory, but this plant, which "
        "has backlash; the thesis's simulation had none.",
    )
