# SPDX-License-Identifier: Apache-2.0
"""Force error without a calibration, with it, and after a change of the calibrated rig.

A calibration is valid for the state of the rig at that time. Later, grease and wear change the
friction, rollers slip to another phase, an operator mounts another handle
(`plant.settings.changed_later`). This experiment measures the modes that use friction model, weight
and mass before and after such a change, as `force_error` does: over all samples, with standstill
and reversals.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from ..control import modes
from ..control.vertical_settings import VerticalSettings
from ..settings import Setting, validated
from . import force_error, friction_model, gravity, inertia, static_torque
from .figures import error_map
from .lab import Lab
from .results import HUMAN_ARM, Experiment, Result

NAME = "robustness"
STATES = {
    "uncalibrated": "not calibrated",
    "calibrated": "calibrated",
    "changed": "changed since it was calibrated",
}


class Settings(NamedTuple):
    """Modes, trials, and seed of the change."""

    modes: Annotated[
        tuple[int, ...], Setting("control modes, as in ForceCommand", choices=())
    ] = (modes.FRICTION_COMPENSATION, modes.COMBINED, modes.OBSERVER)
    cases: Annotated[tuple[str, ...], Setting("trials of force_error by name", choices=())] = (
        "slow", "fast", "small", "holding", "released",
    )  # fmt: skip
    change: Annotated[int, Setting("seed of the rig's change", "", 1, 2**31 - 1)] = 1
    states: Annotated[
        tuple[str, ...], Setting("of the rig: uncalibrated, calibrated, changed", choices=())
    ] = tuple(STATES)
    side_force: Annotated[
        float, Setting("amplitude of the sideways force during motion", "N", 0.0, 50.0)
    ] = force_error.SIDE_FORCE


def run(lab: Lab, settings: Settings) -> Result:
    """Measure every case in every mode and state.

    Data: as in `force_error`, by mode, case and state. Raises MissingResult without the results of
    the calibration, ValueError for unknown cases or modes, NotPossible on a real module, Cancelled.
    """
    validated(settings)
    unknown = set(settings.modes) - set(modes.MODE_NAMES)
    if unknown:
        raise ValueError(f"modes: {min(unknown)} is unknown; known are {list(modes.MODE_NAMES)}")
    if strange := set(settings.states) - set(STATES):
        raise ValueError(f"states: {min(strange)!r} is unknown; known are {', '.join(STATES)}")
    plain = VerticalSettings()
    own = plain.calibrated(
        lab.result(gravity.NAME).value("gravity"), lab.result(inertia.NAME).value("mass")
    )
    models = {
        "friction": friction_model.friction_model_of(lab.result(friction_model.NAME)),
        "linearization": static_torque.measured_linearization(lab),
    }
    laws = {
        "uncalibrated": (plain, {}),
        "calibrated": (own, models),
        "changed": (own, {**models, "changed": settings.change}),
    }
    trials, where = {}, {}
    for mode in settings.modes:
        for case_name in settings.cases:
            case = force_error.pressed(force_error.case_of(case_name), settings.side_force)
            for state in settings.states:
                law, more = laws[state]
                name = f"{force_error.name_of(mode, case_name)}_{state}"
                law = force_error.with_damping(law, mode)
                trials[name] = force_error.trial_of(case, mode, law, **more)
                where[name] = f"{force_error.where_of(mode, case_name)}, {STATES[state]}"
    quantities, data = force_error.figures_of(lab.record(NAME, trials, force_error.reduced), where)
    return Result(NAME, quantities, settings._asdict(), _NOTES, data)
_NOTES = (
    "Not calibrated: the thesis's friction and dead zone, 10 N of weight, 5.5 kg. Calibrated: "
    "friction, dead zone, weight and mass identified on this rig.",
    "Changed: level and phase of the friction, phase of the rollers, weight of the handle and play "
    "differ from those at the calibration; the transducer was tared again.",
)


def rms_of(result: Result, mode: int, case: str) -> tuple[float, float, float]:
    """Return the rms error [N] in each of `STATES`. Raises KeyError for a trial not measured."""
    name = f"rms_{modes.MODE_NAMES[mode].lower()}_{case}"
    uncalibrated, calibrated, changed = (result.value(f"{name}_{state}") for state in STATES)
    return uncalibrated, calibrated, changed


def draw(result: Result) -> dict[str, Figure]:
    """Draw the rms error of every mode and state in every trial as a map."""
    cases = list(result.settings["cases"])
    rows = {
        f"{modes.MODE_NAMES[mode].lower().replace('_', ' ')}, {state}": [
            result.value(f"rms_{force_error.name_of(mode, case)}_{state}") for case in cases
        ]
        for mode in result.settings["modes"]
        for state in result.settings["states"]
    }
    title = "Force error without a calibration, with it, after a change"
    return {"robustness": error_map(np.array(list(rows.values())), list(rows), cases, title)}


EXPERIMENT = Experiment(
    NAME, "force error without a calibration, with it, and after a change of the calibrated rig",
    Settings, run, draw, HUMAN_ARM,
    ("static_torque", "gravity", "friction_model", "inertia"),
)  # fmt: skip
