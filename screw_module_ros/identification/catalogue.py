# SPDX-License-Identifier: Apache-2.0
"""All experiments by name, with their settings and prerequisites."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any, NamedTuple, get_args

from ..plain_yaml import PlainYamlError, load_plain_yaml
from ..quoting import named, quoted
from ..settings import Field, declared, problem
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


_LARGEST_SETTINGS = 10_000  # characters


def settings_from_yaml(text: str, kind: type) -> Any:
    """Return the settings `kind` with the values of a YAML mapping; empty text = defaults.

    Raises ValueError that names the wrong setting.
    """
    if len(text) > _LARGEST_SETTINGS:
        raise ValueError(f"settings are longer than {_LARGEST_SETTINGS} characters")
    try:
        content = load_plain_yaml(text) or {}
    except PlainYamlError as error:
        raise ValueError(f"settings are not YAML: {error}") from None
    if not isinstance(content, dict):
        raise ValueError("settings: a YAML mapping like '{speed: 0.02}' is wanted")
    known = declared(kind)
    for name in content:
        if name not in known:
            raise ValueError(f"settings: {named(name)} is unknown; known are {', '.join(known)}")
    return kind(**{name: _value(known[name], value) for name, value in content.items()})


def _value(field: Field, value: Any) -> Any:
    """Return a value from YAML as the field's type. Raises ValueError."""
    label = f"settings: {field.name}"
    parts = get_args(field.kind)
    if parts:
        if not isinstance(value, list):
            raise ValueError(f"{label} = {quoted(value)}: a list is wanted")
        value = tuple(_plain(label, part, parts[0]) for part in value)
    else:
        value = _plain(label, value, field.kind)
    wrong = problem(field, value, label)
    if wrong:
        raise ValueError(wrong)
    return value


def _plain(label: str, value: Any, kind: type) -> Any:
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        try:
            return float(value)
        except OverflowError:
            raise ValueError(f"{label} = {quoted(value)}: a finite number is wanted") from None
    if type(value) is not kind:
        raise ValueError(f"{label} = {quoted(value)}: {kind.__name__} is wanted")
    return value
