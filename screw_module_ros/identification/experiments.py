# SPDX-License-Identifier: Apache-2.0
"""All experiments in their order, and their settings from a text."""

from __future__ import annotations

from typing import Any

from ..settings import read
from ..settings_file import parse
from . import (
    amplifier_response,
    back_drive,
    calibration,
    compensation,
    compliant_mounting,
    component_masses,
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
    planar_error,
    repeatability,
    robustness,
    stability,
    static_torque,
    torque_response,
)
from .results import Experiment

EXPERIMENTS: dict[str, Experiment] = {
    module.NAME: module.EXPERIMENT
    for module in (
        static_torque, amplifier_response, current_response, torque_response, friction_spectrum,
        friction_map, gravity, friction_model, repeatability, inertia, force_position, force_gain,
        force_error, planar_error, stability, delivered_impedance, compensation, robustness,
        calibration, compliant_mounting, component_masses, back_drive,
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
