# SPDX-License-Identifier: Apache-2.0
"""Force error at the hand in every mode, over all samples, standstill and reversals included.

The thesis evaluates a law by its offset during slow motion (chapter 6), as `force_position` does. A
law with a small offset can still shake a resting hand. Here the error is the patient's true force
minus the commanded impedance K (z - z0) + B z' at the true handle, over all samples. The trials:
slow and fast motion, small reversals, holding still, letting go, resting on walls, a heavy arm,
tremor; in motion with a sideways force, which loads the bearing.

On the live graph, where the handle's true motion and force are unknown, encoder and transducer
replace them. The simulated rig there has no sideways force: `side_force` is 0.

`robustness` measures the modes that use friction model, weight and mass without a calibration, with
it, and after a change of the calibrated rig. A calibration is valid for the state of the rig at
that time. Later, grease and wear change the friction, rollers slip to another phase, an operator
mounts another handle (`plant.settings.changed_later`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from ..control import modes
from ..control.laws import names, variants
from ..control.vertical_settings import VerticalSettings
from ..settings import Setting
from . import friction_model, gravity, inertia, static_torque
from .figures import error_map
from .force_metric import ErrorOf, judged
from .lab import Lab, Part
from .results import HUMAN_ARM, Drawn, Experiment, Quantity, Result
from .trials import HEAVY, Arm, MotionTrial, Samples

NAME = "force_error"
SIDE_FORCE = 8.0  # amplitude of the hand's sideways force during motion [N]
_HAND = Arm()
_NAMES = names()
_CALIBRATED = tuple(mode for mode, variant in variants().items() if variant.uses)


class Case(NamedTuple):
    """One trial of the list. text: description; trial: without mode and settings."""

    text: str
    trial: MotionTrial


def wall(stiffness: float, ratio: float, mass: float = 5.5) -> Arm:
    """Return a wall, without mass as it does not move; stiffness [N/m]; ratio: damping ratio for
    the module's mass [kg]."""
    return Arm(0.0, stiffness, 2.0 * ratio * math.sqrt(stiffness * mass))


def _moving(text: str, amplitude: float, omega: float, duration: float, **more: Any) -> Case:
    return Case(text, MotionTrial(
        modes.OFF, VerticalSettings(), amplitude=amplitude, omega=omega, duration=duration,
        side_force=SIDE_FORCE, **more,
    ))  # fmt: skip


def _resting(text: str, arm: Arm, **more: Any) -> Case:
    return Case(text, MotionTrial(
        modes.OFF, VerticalSettings(), arm=arm, amplitude=0.0, way=0.05, duration=8.0, **more
    ))  # fmt: skip


WALLS = {
    f"wall_1e{power}_{word}": (f"a wall of 1e{power} N/m, {word} damped", 10.0**power, ratio)
    for power in (3, 4, 5, 6)
    for word, ratio in (("well", 0.7), ("badly", 0.02))
}
"""Text, stiffness [N/m], and damping ratio for the module's mass."""
CASES = {
    "slow": _moving("0.15 m at 0.8 rad/s", 0.15, 0.8, 15.8),
    "fast": _moving("0.10 m at 3 rad/s", 0.10, 3.0, 8.4),
    "small": _moving("0.03 m at 1.5 rad/s", 0.03, 1.5, 12.6),
    "tremor": _moving("0.05 m at 0.8 rad/s with 8 mm of tremor", 0.05, 0.8, 7.9, tremor=0.008),
    "heavy": _moving("an arm of 30 kg, 0.05 m at 0.8 rad/s", 0.05, 0.8, 7.9, arm=HEAVY),
    "holding": _resting("a hand that holds still 0.05 m off", _HAND),
    "released": _resting("a hand that holds, and lets go", _HAND, released_after=3.0),
    "heavy_holding": _resting("an arm of 30 kg that holds still", HEAVY),
    **{name: _resting(text, wall(*how)) for name, (text, *how) in WALLS.items()},
}  # fmt: skip


class Settings(NamedTuple):
    """Modes, trials, and the law's impedance."""

    modes: Annotated[tuple[int, ...], Setting("as in ForceCommand, or of laws of others")] = tuple(
        variants()
    )
    cases: Annotated[
        tuple[str, ...], Setting("trials by name", choices=tuple(CASES))
    ] = tuple(CASES)
    stiffness: Annotated[float, Setting("of the spring", "N/m", 0.0, 5000.0)] = 100.0
    damping: Annotated[
        float, Setting("of the damper; OBSERVER has at least its minimum", "Ns/m", 0.0, 500.0)
    ] = 0.0
    side_force: Annotated[
        float, Setting("amplitude of the sideways force during motion", "N", 0.0, 50.0)
    ] = SIDE_FORCE


def run(lab: Lab, settings: Settings) -> Result:
    """Measure every case in every mode. Raises Cancelled, NotPossible."""
    law = VerticalSettings(stiffness=settings.stiffness, damping=settings.damping)
    return _measured(lab, NAME, settings, {"": (law, "", {})}, _NOTES)


_NOTES = (
    "Error: the patient's true force minus K (z - z0) + B z' at the true handle, over all samples; "
    "in OBSERVER B is at least the minimum of the mode. Data of each trial: mean, rms, 99th "
    "percentile and rms above 30 Hz of the error [N], its rms above 3 Hz in the last second [N], "
    "travel of the handle in the last second [m], remaining share of the force gain at the end.",
    "Resting on a wall: a spring of 1e3 to 1e6 N/m holds the handle, with a damping ratio of 0.7 "
    "or 0.02 for the module's mass.",
)


def _measured(
    lab: Lab, experiment: str, settings: Any,
    laws: dict[str, tuple[VerticalSettings, str, dict[str, Any]]], notes: tuple[str, ...],
) -> Result:  # fmt: skip
    """Measure every case in every mode with every law; data: `ErrorOf` as arrays.

    laws: end of a trial's name -> law, description, further fields of the trial.
    """
    trials, where, named = {}, {}, _named(lab, settings.modes)
    for mode in settings.modes:
        for case in settings.cases:
            for end, (law, said, more) in laws.items():
                name, own = f"{name_of(mode, case, named)}{end}", with_damping(law, mode)
                trials[name] = trial_of(case, mode, own, settings.side_force, **more)
                where[name] = f"{named[mode].lower()}, {CASES[case].text}{said}"
    data = {
        name: np.array(ErrorOf(**{key: float(value) for key, value in part.items()}))
        for name, part in lab.record(experiment, trials, reduced).items()
    }
    rms = ErrorOf._fields.index("rms")
    quantities = tuple(
        Quantity(f"rms_{name}", float(data[name][rms]), math.nan, "N", f"rms error, {where[name]}")
        for name in trials
    )
    known, others = settings._asdict(), set(settings.modes) - set(names())
    if others:
        known["names"] = {str(mode): named[mode] for mode in sorted(others)}
    return Result(experiment, quantities, known, notes, data)


def _named(lab: Lab, chosen: tuple[int, ...]) -> dict[int, str]:
    """Return the names of all modes of the lab's laws. Raises ValueError for one that is none."""
    named = names(lab.stand.laws)
    if unknown := sorted(set(chosen) - set(named)):
        raise ValueError(f"modes = {unknown[0]}: one of {', '.join(map(str, named))} is wanted")
    return named


def names_in(result: Result) -> dict[int, str]:
    """Return the names of the modes of a result, those of laws of others among them."""
    return names() | {int(mode): name for mode, name in result.settings.get("names", {}).items()}


def name_of(mode: int, case: str, named: Mapping[int, str] = _NAMES) -> str:
    """Return the name of a trial of a case in a mode; named: names of the modes."""
    return f"{named[mode].lower()}_{case}"


def with_damping(law: VerticalSettings, mode: int) -> VerticalSettings:
    """Return the law, in OBSERVER with at least its least damping."""
    if mode == modes.OBSERVER:
        return law._replace(damping=max(law.damping, law.least_damping))
    return law


def trial_of(
    case: str, mode: int, law: VerticalSettings, side_force: float = SIDE_FORCE, **changes: Any
) -> MotionTrial:
    """Return one of `CASES` in a mode.

    side_force: amplitude [N], where the case has one at all; changes: friction, linearization of
    the module.
    """
    trial = CASES[case].trial
    sideways = side_force if trial.side_force else 0.0
    return trial._replace(mode=mode, settings=law, side_force=sideways, **changes)


def reduced(trial: MotionTrial, samples: Samples) -> Part:
    """Return the figures of `force_metric.judged`."""
    period = samples.time[1] - samples.time[0]
    position, velocity, force = samples.felt
    first = 3.0 if trial.way else 0.0  # a resting hand must first arrive
    if math.isfinite(trial.released_after):
        first = trial.released_after + 3.0
    found = judged(
        period, position - trial.centre, velocity, force, samples.share, trial.settings.stiffness,
        trial.settings.damping, round(first / period),
    )  # fmt: skip
    return {name: np.array(value) for name, value in found._asdict().items()}


def draw(result: Result) -> Drawn:
    """Draw the rms error of every mode in every trial as a map."""
    title = "Force beyond the impedance asked for, all samples"
    return {"force error": _map(result, {"": ""}, title)}


def _map(result: Result, states: Mapping[str, str], title: str) -> Figure:
    """Return the map of rms errors; states: end of a trial's name -> end of the name of a row."""
    cases, named = list(result.settings["cases"]), names_in(result)
    rows = {
        f"{named[mode].lower().replace('_', ' ')}{said}": [
            result.value(f"rms_{name_of(mode, case, named)}{end}") for case in cases
        ]
        for mode in result.settings["modes"]
        for end, said in states.items()
    }
    return error_map(rows, cases, title)


EXPERIMENT = Experiment(
    NAME, "force error at the hand in every mode, over all samples, at rest and in motion",
    Settings, run, draw, HUMAN_ARM,
)  # fmt: skip


# Calibrated, and changed since --------------------------------------------------------------

STATES = {
    "uncalibrated": "not calibrated",
    "calibrated": "calibrated",
    "changed": "changed since it was calibrated",
}


class RobustnessSettings(NamedTuple):
    """Modes, trials, and seed of the change."""

    modes: Annotated[
        tuple[int, ...], Setting("as in ForceCommand, or of laws of others")
    ] = _CALIBRATED
    cases: Annotated[tuple[str, ...], Setting("trials by name", choices=tuple(CASES))] = (
        "slow", "fast", "small", "holding", "released",
    )  # fmt: skip
    change: Annotated[int, Setting("seed of the rig's change", "", 1, 2**31 - 1)] = 1
    states: Annotated[
        tuple[str, ...], Setting("of the rig", choices=tuple(STATES))
    ] = tuple(STATES)
    side_force: Annotated[
        float, Setting("amplitude of the sideways force during motion", "N", 0.0, 50.0)
    ] = SIDE_FORCE


def run_changed(lab: Lab, settings: RobustnessSettings) -> Result:
    """Measure every case in every mode and state.

    Data: as in `run`, by mode, case and state. Raises MissingResult without the results of
    the calibration, NotPossible on a real module, Cancelled.
    """
    _named(lab, settings.modes)
    plain = VerticalSettings()
    own = plain.calibrated(
        lab.result(gravity.NAME).value("gravity"), lab.result(inertia.NAME).value("mass")
    )
    models = {
        "friction": friction_model.friction_model_of(lab.result(friction_model.NAME)),
        "linearization": static_torque.measured_linearization(lab),
    }
    laws: dict[str, tuple[VerticalSettings, dict[str, Any]]] = {
        "uncalibrated": (plain, {}),
        "calibrated": (own, models),
        "changed": (own, {**models, "changed": settings.change}),
    }
    chosen = {
        f"_{state}": (laws[state][0], f", {STATES[state]}", laws[state][1])
        for state in settings.states
    }
    return _measured(lab, "robustness", settings, chosen, _CHANGED)


_CHANGED = (
    "Not calibrated: the thesis's friction and dead zone, 10 N of weight, 5.5 kg. Calibrated: "
    "friction, dead zone, weight and mass identified on this rig.",
    "Changed: level and phase of the friction, phase of the rollers, weight of the handle and play "
    "differ from those at the calibration; the transducer was tared again.",
)


def rms_of(result: Result, mode: int, case: str) -> tuple[float, float, float]:
    """Return the rms error [N] in each of `STATES`. Raises KeyError for a trial not measured."""
    name = f"rms_{name_of(mode, case, names_in(result))}"
    uncalibrated, calibrated, changed = (result.value(f"{name}_{state}") for state in STATES)
    return uncalibrated, calibrated, changed


def draw_changed(result: Result) -> Drawn:
    """Draw the rms error of every mode and state in every trial as a map."""
    states = {f"_{state}": f", {state}" for state in result.settings["states"]}
    title = "Force error without a calibration, with it, after a change"
    return {"robustness": _map(result, states, title)}


ROBUSTNESS = Experiment(
    "robustness",
    "force error without a calibration, with it, and after a change of the calibrated rig",
    RobustnessSettings, run_changed, draw_changed, HUMAN_ARM,
    ("static_torque", "gravity", "friction_model", "inertia"),
)  # fmt: skip
