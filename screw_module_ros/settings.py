# SPDX-License-Identifier: Apache-2.0
"""Settings declared once: a NamedTuple field carries its description, unit and bounds.

A law or a driver has its parameters in a NamedTuple with complete annotations::

    class Spring(NamedTuple):
        stiffness: Annotated[float, Setting("spring constant", "N/m", 0.0, 5000.0)] = 100.0

`validated` checks the values against the bounds; `nodes/support/parameters.py` declares ROS
parameters from the same annotations. Compiled functions accept NamedTuples directly.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple, TypeVar, get_args, get_origin, get_type_hints

from .quoting import quoted

Settings = TypeVar("Settings", bound=tuple)


class Setting(NamedTuple):
    """Description of one field.

    text: description, one sentence without the unit
    unit: SI unit as text, empty for none
    low: smallest value allowed, None for no bound
    high: largest value allowed, None for no bound
    choices: the values allowed, empty for any
    live: may change while the node is configured or active
    at_start: set when the process starts and fixed from then on: a sender of messages must not
        choose where the node writes
    """

    text: str
    unit: str = ""
    low: float | None = None
    high: float | None = None
    choices: tuple = ()
    live: bool = False
    at_start: bool = False


class Field(NamedTuple):
    """One declared field: its name, its Python type, its default and its `Setting`."""

    name: str
    kind: Any
    default: Any
    setting: Setting


_declared: dict[type, dict[str, Field]] = {}


def declared(kind: type) -> dict[str, Field]:
    """Return the fields of the NamedTuple `kind` that carry a `Setting`, by name."""
    if kind not in _declared:
        _declared[kind] = dict(_read(kind))
    return _declared[kind]


def _read(kind: type):
    defaults = getattr(kind, "_field_defaults", {})
    for name, hint in get_type_hints(kind, include_extras=True).items():
        if get_origin(hint) is not Annotated:
            continue
        base, *notes = get_args(hint)
        for note in notes:
            if isinstance(note, Setting):
                yield name, Field(name, base, defaults.get(name), note)


def problem(field: Field, value: Any, label: str | None = None) -> str:
    """Return the problem of `value` for `field`, or an empty string.

    label: the user's name of the field, if it differs.
    """
    name, setting = label or field.name, field.setting
    unit = f" {setting.unit}" if setting.unit else ""
    text = f"{name} = {quoted(value)}"
    if setting.choices and value not in setting.choices:
        return f"{text}: one of {', '.join(map(repr, setting.choices))} is wanted"
    numbers = value if isinstance(value, (tuple, list)) else (value,)
    for number in numbers:
        if isinstance(number, (bool, str)) or not isinstance(number, (int, float)):
            continue
        if not _is_finite(number):
            return f"{text}: a finite number is wanted"
        if setting.low is not None and number < setting.low:
            return f"{text}{unit}: below the smallest allowed, {setting.low:g}{unit}"
        if setting.high is not None and number > setting.high:
            return f"{text}{unit}: above the largest allowed, {setting.high:g}{unit}"
    return ""


def _is_finite(number: float) -> bool:
    """Return whether a number fits into a finite float."""
    try:
        return math.isfinite(number)
    except OverflowError:  # an integer beyond
        return False


def validated(settings: Settings) -> Settings:
    """Return `settings` unchanged when every field is within its bounds.

    Raises ValueError naming the first field that is not, its value and its bound.
    """
    for name, field in declared(type(settings)).items():
        wrong = problem(field, getattr(settings, name))
        if wrong:
            raise ValueError(f"{type(settings).__name__}: {wrong}")
    return settings
