# SPDX-License-Identifier: Apache-2.0
"""Settings declared once.

A law, a driver or a file has its values in a NamedTuple with complete annotations::

    class Spring(NamedTuple):
        stiffness: Annotated[float, Setting("spring constant", "N/m", 0.0, 5000.0)] = 100.0

A record may hold other records, tuples, and dictionaries. If its values must fit together, it has a
method `flaw()` that returns what does not, empty if nothing. `validated` checks a record, `read`
makes one of a mapping, `read_file` of `settings_file.py` of a YAML file;
`nodes/support/parameters.py` declares ROS parameters from the same annotations. Compiled functions
accept NamedTuples directly.
"""

from __future__ import annotations

import math
import types
from functools import cache
from typing import Annotated, Any, NamedTuple, TypeVar, Union, get_args, get_origin, get_type_hints

_LONGEST = 80  # longest value in a message [characters]

Record = TypeVar("Record", bound=tuple)


class SettingError(ValueError):
    """A value that cannot be used; the message names it, the problem and, if known, the file."""


class Setting(NamedTuple):
    """Description of one field.

    text: description, one sentence without the unit
    unit: SI unit as text, empty for none
    low, high: smallest and largest value allowed
    choices: the values allowed, empty for any
    live: may change while the node is configured or active
    at_start: set when the process starts and fixed from then on: a sender of messages must not
        choose where the node writes
    formerly: name until the last release, still taken for this one where a node starts, with a
        warning; empty for none
    """

    text: str
    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    choices: tuple = ()
    live: bool = False
    at_start: bool = False
    formerly: str = ""


class Field(NamedTuple):
    """One field of a record: its name, its Python type and its `Setting`, without text if none."""

    name: str
    kind: Any
    setting: Setting


@cache
def fields(kind: type) -> dict[str, Field]:
    """Return the fields of the NamedTuple `kind` by name."""
    found = {}
    for name, hint in get_type_hints(kind, include_extras=True).items():
        base, *notes = get_args(hint) if get_origin(hint) is Annotated else (hint,)
        setting = next((note for note in notes if isinstance(note, Setting)), Setting(""))
        found[name] = Field(name, base, setting)
    return found


def shown(value: Any) -> str:
    """Return `repr` of a value for a message, cut to 80 characters."""
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."


def problem(field: Field, value: Any, label: str = "") -> str:
    """Return what is wrong with a value of the right type for `field`, empty if nothing.

    label: the user's name of the field, if it differs.
    """
    name, setting = label or field.name, field.setting
    if hasattr(value, "_fields"):
        return _flaw(value, f"{name}.")
    if isinstance(value, (tuple, list)):
        parts = (problem(field, part, f"{name}[{n}]") for n, part in enumerate(value))
        return next(filter(None, parts), "")
    unit = f" {setting.unit}" if setting.unit else ""
    text = f"{name} = {shown(value)}"
    if setting.choices and value not in setting.choices:
        return f"{text}: one of {', '.join(map(repr, setting.choices))} is wanted"
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return ""
    if not -math.inf < value < math.inf:
        return f"{text}: a finite number is wanted"
    if value < setting.low:
        return f"{text}{unit}: below the smallest allowed, {setting.low:g}{unit}"
    if value > setting.high:
        return f"{text}{unit}: above the largest allowed, {setting.high:g}{unit}"
    return ""


def _flaw(record: Any, prefix: str = "") -> str:
    """Return the first problem of a record's fields, or of how they fit together."""
    kind: type = type(record)
    for name, field in fields(kind).items():
        if wrong := problem(field, getattr(record, name), prefix + name):
            return wrong
    flaw = record.flaw() if hasattr(record, "flaw") else ""
    return flaw and prefix + flaw


def validated(record: Record) -> Record:
    """Return a record unchanged when each field is within its bounds and all fit together.

    Raises SettingError naming the first field that is wrong, its value and the problem.
    """
    if wrong := _flaw(record):
        raise SettingError(f"{type(record).__name__}: {wrong}")
    return record


def read(kind: type, mapping: Any, where: str = "") -> Any:
    """Return a mapping as the record `kind`; a field with a default may be missing.

    where: name of the mapping in messages, empty at the top. Raises SettingError naming the key
    that is unknown, missing, of another type or out of range.
    """
    record = _record(kind, mapping, where)
    if wrong := _flaw(record, f"{where}." if where else ""):
        raise SettingError(wrong)
    return record


def _record(kind: Any, mapping: Any, where: str) -> Any:
    known, prefix = fields(kind), f"{where}." if where else ""
    if not isinstance(mapping, dict):
        named = f"{where} = " if where else ""
        raise SettingError(f"{named}{shown(mapping)}: a mapping of names to values is wanted")
    for key in mapping:
        if key not in known:
            raise SettingError(f"{prefix}{key} is unknown; known are {', '.join(known)}")
    for name in known:
        if name not in mapping and name not in kind._field_defaults:
            raise SettingError(f"{prefix}{name} is missing")
    return kind(**{name: _value(known[name].kind, mapping[name], prefix + name)
                   for name in mapping})  # fmt: skip


def _value(kind: Any, value: Any, name: str) -> Any:
    """Return a value of a YAML file as the type `kind`."""
    outer, parts, text = get_origin(kind), get_args(kind), f"{name} = {shown(value)}"
    if outer in (Union, types.UnionType):
        return None if value is None else _value(parts[0], value, name)
    if hasattr(kind, "_fields"):
        return _record(kind, value, name)
    if outer is tuple:
        count = 0 if parts[-1] is ... else len(parts)
        if not isinstance(value, list) or count and len(value) != count:
            raise SettingError(f"{text}: a list{f' of {count}' if count else ''} is wanted")
        return tuple(_value(parts[0], part, f"{name}[{n}]") for n, part in enumerate(value))
    if outer is dict and isinstance(value, dict):
        return {str(key): _value(parts[1], part, f"{name}.{key}") for key, part in value.items()}
    if kind is float:
        if type(value) not in (int, float) or not abs(value) < 1e300:
            raise SettingError(f"{text}: a finite number is wanted (write 1.0e-4, not 1e-4)")
        return float(value)
    if kind is not Any and type(value) is not (outer or kind):
        raise SettingError(f"{text}: {(outer or kind).__name__} is wanted")
    return value


def plain(value: Any) -> Any:
    """Return what `read` takes: mappings, lists and values of Python's own types."""
    if hasattr(value, "_fields"):
        return {name: plain(getattr(value, name)) for name in value._fields}
    if isinstance(value, dict):
        return {str(key): plain(part) for key, part in value.items()}
    if hasattr(value, "tolist"):  # numpy's numbers and arrays
        return value.tolist()
    return [plain(part) for part in value] if isinstance(value, (list, tuple)) else value
