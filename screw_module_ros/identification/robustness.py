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

from ..control import modes
from ..control.vertical_settings import VerticalSettings
from ..settings import Setting, validated
from . import force_error, friction_fit, gravity, inertia, static_torque
from .lab import Job, Lab
from .results import Result

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
    models = {
        "friction": friction_fit.friction_model_of(lab.result(friction_fit.NAME)),
        "linearization": static_torque.linearization_of(lab.result(static_torque.NAME)),
    }
    plain = VerticalSettings()
    own = plain.calibrated(
        lab.result(gravity.NAME).value("gravity"), lab.result(inertia.NAME).value("mass")
    )
    jobs = {}
    for mode in settings.modes:
        for name in settings.cases:
            case = force_error.pressed(force_error.case_of(name), settings.side_force)
            for state in settings.states:
                law = plain if state == "uncalibrated" else own
                more = {} if state == "uncalibrated" else models
                if state == "changed":
                    more = {**models, "changed": settings.change}
                law = force_error.with_damping(law, mode)
                one = force_error.job(case, mode, law, **more)
                jobs[mode, name, state] = one._replace(name=f"{one.name}_{state}")
    parts = lab.run(NAME, list(jobs.values()))
    return _result(settings, jobs, parts)


def _result(
    settings: Settings, jobs: dict[tuple[int, str, str], Job], parts: dict[str, dict]
) -> Result:
    quantities, data = [], {}
    for (mode, name, state), one in jobs.items():
        where = f"{force_error.where_of(mode, name)}, {STATES[state]}"
        rms, data[one.name] = force_error.figures(one, parts[one.name], where)
        quantities.append(rms)
    return Result(NAME, tuple(quantities), settings._asdict(), _NOTES, data)


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
