# SPDX-License-Identifier: Apache-2.0
"""Force error in the plane, with and without compensation of friction and mass (2.2.4, appendix D).

The error is what the hand feels beyond the spring and damper asked for, its true force less
K x + B v of the true handle, over all samples as in `force_error`: in slow and fast motion along x,
y and between, holding still, letting go, with an arm of 30 kg, a tremor, and on walls.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from ..control.planar_settings import PlanarSettings
from ..settings import Setting
from .figures import error_map
from .force_error import counted_from, wall
from .force_metric import ErrorOf, judged
from .lab import Lab, Part
from .results import HUMAN_ARM, Experiment, Quantity, Result
from .trials import Arm, PlanarTrial, Samples

NAME = "planar_error"
KINDS = ("none", "friction", "mass", "both")
_HAND = Arm()
_HEAVY = Arm(30.0, 300.0, 30.0)
_WALL_MASS = 6.5  # module and arm, for the damping ratio of a wall [kg]
_BETWEEN = 0.25 * math.pi


class Case(NamedTuple):
    """One trial of the list. text; trial: with the settings to be filled in."""

    text: str
    trial: PlanarTrial


def _moving(text: str, amplitude: float, omega: float, seconds: float, **more: Any) -> Case:
    trial = PlanarTrial(
        PlanarSettings(), amplitude=amplitude, omega=omega, duration=seconds, **more
    )
    return Case(text, trial)


def _resting(text: str, arm: Arm, **more: Any) -> Case:
    trial = PlanarTrial(PlanarSettings(), arm=arm, way=0.05, duration=8.0, **more)
    return Case(text, trial)


CASES = {
    "slow_x": _moving("0.10 m at 0.8 rad/s along x", 0.10, 0.8, 7.9),
    "slow_y": _moving("0.10 m at 0.8 rad/s along y", 0.10, 0.8, 7.9, direction=2.0 * _BETWEEN),
    "fast_x": _moving("0.08 m at 3 rad/s along x", 0.08, 3.0, 6.3),
    "fast_y": _moving("0.08 m at 3 rad/s along y", 0.08, 3.0, 6.3, direction=2.0 * _BETWEEN),
    "fast_between": _moving("0.08 m at 3 rad/s between x and y", 0.08, 3.0, 6.3,
            direction=_BETWEEN),
    "small": _moving("0.02 m at 1.5 rad/s between x and y", 0.02, 1.5, 8.4, direction=_BETWEEN),
    "tremor": _moving("0.05 m at 0.8 rad/s with 8 mm of tremor", 0.05, 0.8, 7.9, tremor=0.008),
    "heavy": _moving("an arm of 30 kg, 0.05 m at 0.8 rad/s", 0.05, 0.8, 7.9, arm=_HEAVY),
    "holding": _resting("a hand that holds still 0.05 m off", _HAND, direction=_BETWEEN),
    "released": _resting("a hand that holds, and lets go", _HAND, released_after=3.0,
             direction=_BETWEEN),
    **{
        f"wall_1e{power}_{word}": _resting(f"a wall of 1e{power} N/m, {word} damped",
                                           wall(10.0**power, ratio, _WALL_MASS))
        for power in (3, 4, 5, 6)
        for word, ratio in (("well", 0.7), ("badly", 0.02))
    },
}  # fmt: skip


class Settings(NamedTuple):
    """What is compensated, and in which trials."""

    kinds: Annotated[
        tuple[str, ...], Setting("what is compensated", choices=KINDS)
    ] = KINDS
    cases: Annotated[
        tuple[str, ...], Setting("trials by name", choices=tuple(CASES))
    ] = tuple(CASES)
    joint_friction: Annotated[
        float, Setting("friction of each joint that is fed forward", "Nm", 0.0, 1.0)
    ] = 0.24
    carried_mass: Annotated[
        float, Setting("part of the module's mass that is carried", "kg", 0.0, 3.0)
    ] = 3.0
    stiffness: Annotated[float, Setting("of the spring", "N/m", 0.0, 2000.0)] = 100.0
    damping: Annotated[float, Setting("of the damper", "Ns/m", 0.0, 200.0)] = 10.0


def run(lab: Lab, settings: Settings) -> Result:
    """Measure every case with every compensation.

    Raises NotPossible on a real robot, Cancelled.
    """
    trials = {
        (kind, case): CASES[case].trial._replace(settings=law_of(settings, kind))
        for kind in settings.kinds
        for case in settings.cases
    }
    named = {"_".join(key): trial for key, trial in trials.items()}
    parts = lab.record(NAME, named, reduced)
    found = {key: error_of(parts["_".join(key)]) for key in trials}
    quantities = [
        Quantity(f"rms_{kind}_{name}", error.rms, math.nan, "N",
                 f"rms error, compensated: {kind}, {CASES[name].text}")
        for (kind, name), error in found.items()
    ]  # fmt: skip
    if {("none", "fast_x"), ("both", "fast_x")} <= set(found):
        ratio = found["none", "fast_x"].rms / found["both", "fast_x"].rms
        text = "rms error in fast motion along x, not compensated over compensated"
        quantities.append(Quantity("gain_fast_x", ratio, math.nan, "", text))
    data = {"_".join(key): np.array(error) for key, error in found.items()}
    return Result(NAME, tuple(quantities), settings._asdict(), _NOTES, data)


_NOTES = (
    "Error: the patient's true force in the plane less K x + B v of the true handle, both axes "
    "together, over all samples. Data of each trial as in force_error; travel, swing and shaking "
    "are those of the worse axis.",
    "500 samples per second, 0.7 ms from a sample to its torque, filters and counts as in `manus`; "
    "buses and processes are left out.",
)


def law_of(settings: Settings, kind: str) -> PlanarSettings:
    """Return the planar law's numbers with a compensation of `KINDS`."""
    return PlanarSettings(
        stiffness=settings.stiffness,
        damping=settings.damping,
        joint_friction=settings.joint_friction if kind in ("friction", "both") else 0.0,
        carried_mass=settings.carried_mass if kind in ("mass", "both") else 0.0,
    )


def error_of(part: Part) -> ErrorOf:
    """Return the error of both axes together."""
    x, y = (ErrorOf(*map(float, part[axis])) for axis in ("x", "y"))
    together = {name: math.hypot(getattr(x, name), getattr(y, name)) for name in _ADDED}
    worse = {name: max(getattr(x, name), getattr(y, name)) for name in _WORSE}
    return ErrorOf(**together, **worse, share=x.share)


_ADDED = ("mean", "rms", "p99", "rapid")
_WORSE = ("swing", "travel", "shaking")


def reduced(trial: PlanarTrial, samples: Samples) -> Part:
    """Return `ErrorOf` of each axis as an array."""
    period = float(samples.time[1] - samples.time[0])
    law, (position, velocity, force) = trial.settings, samples.felt
    return {
        axis: np.array([*judged(
            period, position[:, column], velocity[:, column], force[:, column], samples.share,
            law.stiffness, law.damping, round(counted_from(trial) / period),
        )])
        for column, axis in enumerate(("x", "y"))
    }  # fmt: skip


def draw(result: Result) -> dict[str, Figure]:
    """Draw the rms error of every trial with every compensation as a map."""
    kinds, cases = list(result.settings["kinds"]), list(result.settings["cases"])
    rms = [[result.value(f"rms_{kind}_{case}") for case in cases] for kind in kinds]
    labels = [f"compensated: {kind}" for kind in kinds]
    title = "Force in the plane beyond the impedance asked for, all samples"
    return {"planar error": error_map(np.array(rms), labels, cases, title)}


EXPERIMENT = Experiment(
    NAME, "force error in the plane, with and without compensation of friction and mass (2.2.4)",
    Settings, run, draw, HUMAN_ARM,
)  # fmt: skip
