# SPDX-License-Identifier: Apache-2.0
"""All experiments in their order, and their settings from a text."""

from __future__ import annotations

from typing import Any

from ..settings import read
from ..settings_file import parse
from . import (
    amplifier_response,
    calibration,
    current_response,
    delivered_impedance,
    force_error,
    force_gain,
    force_position,
    friction_map,
    friction_model,
    friction_spectrum,
    gravity,
    inertia,
    planar_impedance,
    planar_stability,
    repeatability,
    requirements,
    stability,
    static_torque,
    torque_response,
)
from .results import Experiment

EXPERIMENTS: dict[str, Experiment] = {
    experiment.name: experiment
    for experiment in (
        static_torque.EXPERIMENT, amplifier_response.EXPERIMENT, current_response.EXPERIMENT,
        torque_response.EXPERIMENT, friction_spectrum.EXPERIMENT, friction_map.EXPERIMENT,
        gravity.EXPERIMENT, friction_model.EXPERIMENT, repeatability.EXPERIMENT,
        inertia.EXPERIMENT, force_position.EXPERIMENT, force_gain.EXPERIMENT,
        force_error.EXPERIMENT, planar_stability.EXPERIMENT,
        stability.EXPERIMENT, delivered_impedance.EXPERIMENT, planar_impedance.EXPERIMENT,
        force_position.COMPENSATION, force_error.ROBUSTNESS, calibration.EXPERIMENT,
        requirements.EXPERIMENT,
    )
}  # fmt: skip


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
