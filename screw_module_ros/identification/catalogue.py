# SPDX-License-Identifier: Apache-2.0
"""All experiments by name, with their settings and prerequisites."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any, NamedTuple

from ..settings import parse, read
from . import (
    amplifier_response,
    back_drive,
    calibration,
    compensation,
    component_masses,
    current_response,
    curves,
    delivered_impedance,
    force_error,
    force_gain,
    friction_fit,
    friction_map,
    friction_spectrum,
    gravity,
    inertia,
    mounting,
    planar_error,
    repeatability,
    robustness,
    stability,
    static_torque,
    torque_response,
)
from .lab import Lab
from .results import Result

LOCKED_ROTOR, STAGE, HUMAN_ARM, ANALYZER, NOTHING = (
    "locked_rotor", "stage", "human_arm", "analyzer", "nothing",
)  # fmt: skip


class Experiment(NamedTuple):
    """One experiment.

    text: one-line description; settings: NamedTuple of its settings; fixture: required mounting of
    handle or rotor; needs: experiments whose results it reads.
    """

    name: str
    text: str
    settings: type
    run: Callable[[Lab, Any], Result]
    fixture: str
    needs: tuple[str, ...]


def _of(module: ModuleType, fixture: str, *needs: ModuleType) -> Experiment:
    text = (module.__doc__ or "").strip().splitlines()[0]
    return Experiment(
        module.NAME,
        text,
        module.Settings,
        module.run,
        fixture,
        tuple(need.NAME for need in needs),
    )


EXPERIMENTS: dict[str, Experiment] = {
    experiment.name: experiment
    for experiment in (
        _of(static_torque, LOCKED_ROTOR),
        _of(amplifier_response, ANALYZER),
        _of(current_response, LOCKED_ROTOR, static_torque),
        _of(torque_response, LOCKED_ROTOR, static_torque),
        _of(friction_spectrum, STAGE),
        _of(friction_map, STAGE),
        _of(gravity, STAGE, friction_map),
        _of(friction_fit, NOTHING, friction_map, gravity),
        _of(repeatability, STAGE),
        _of(inertia, HUMAN_ARM, friction_fit),
        _of(curves, HUMAN_ARM),
        _of(force_gain, HUMAN_ARM),
        _of(force_error, HUMAN_ARM),
        _of(planar_error, HUMAN_ARM),
        _of(stability, HUMAN_ARM),
        _of(delivered_impedance, HUMAN_ARM, stability),
        _of(compensation, HUMAN_ARM, static_torque, gravity, friction_fit),
        _of(robustness, HUMAN_ARM, static_torque, gravity, friction_fit, inertia),
        _of(calibration, NOTHING, static_torque, gravity, friction_fit, inertia),
        _of(mounting, NOTHING),
        _of(component_masses, NOTHING),
        _of(back_drive, NOTHING),
    )
}


def listing() -> str:
    """Return a list of the experiments as text, one per line."""
    return "\n".join(
        f"{e.name} ({e.fixture}{', after ' + ', '.join(e.needs) if e.needs else ''}): {e.text}"
        for e in EXPERIMENTS.values()
    )


def settings_from_yaml(text: str, kind: type) -> Any:
    """Return the settings `kind` with the values of a YAML mapping; empty text = defaults.

    Raises SettingError that names the wrong setting.
    """
    content = parse(text, "settings")
    return read(kind, {} if content is None else content, "settings")
