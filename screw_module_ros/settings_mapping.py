# SPDX-License-Identifier: Apache-2.0
"""Converts the mapping of a file to settings tuples; checks every key and value."""

from __future__ import annotations

import types
from collections.abc import Mapping
from typing import Any, Union, get_args, get_origin, get_type_hints

from .quoting import named, quoted
from .settings import declared, problem

_MOST = 200  # entries of a list; with aliases a few bytes could make many
NO_SIZES: Mapping[str, int] = types.MappingProxyType({})


def from_mapping(
    kind: type, content: Any, where: str = "", sizes: Mapping[str, int] = NO_SIZES
) -> Any:
    """Return `content` as the NamedTuple `kind`, which may hold others.

    where: prefix of the keys in messages, empty at the top. sizes: of fields that are plain tuples
    of numbers, by field name. A field with a default may be missing.
    Raises ValueError naming the key that is unknown, missing, of another type or out of range.
    """
    if not isinstance(content, dict):
        raise ValueError(f"{where or 'the file'}: a mapping of names to values is wanted")
    hints = get_type_hints(kind)
    for key in content:
        if key not in hints:
            raise ValueError(f"{where}{named(key)} is unknown; known are {', '.join(hints)}")
    missing = [name for name in hints if name not in {*content, *kind._field_defaults}]
    if missing:
        raise ValueError(f"{where}{missing[0]} is missing")
    values = {
        name: _value(hint, content[name], where + name, sizes.get(name, 0), sizes)
        for name, hint in hints.items()
        if name in content
    }
    for name, field in declared(kind).items():
        wrong = problem(field, values[name], where + name) if values.get(name) is not None else ""
        if wrong:
            raise ValueError(wrong)
    return kind(**values)


def _value(hint: Any, value: Any, label: str, size: int, sizes: Mapping[str, int]) -> Any:
    if get_origin(hint) in (Union, types.UnionType):
        if value is None:
            return None
        hint = next(each for each in get_args(hint) if each is not type(None))
    if hasattr(hint, "_fields"):
        return from_mapping(hint, value, f"{label}.", sizes)
    if get_args(hint)[-1:] == (Ellipsis,):
        return _sections(get_args(hint)[0], value, label, sizes)
    if hint is tuple or get_origin(hint) is tuple:
        return _numbers(value, label, size or len(get_args(hint)))
    if hint is float:
        if type(value) not in (int, float):
            raise ValueError(
                f"{label} = {quoted(value)}: a number is wanted (write 1.0e-4, not 1e-4)"
            )
        return _double(value, label)
    if type(value) is not hint:
        raise ValueError(f"{label} = {quoted(value)}: {hint.__name__} is wanted")
    return value


def _sections(kind: type, value: Any, label: str, sizes: Mapping[str, int]) -> tuple:
    if not isinstance(value, list) or not value:
        raise ValueError(f"{label}: a list is wanted")
    if len(value) > _MOST:
        raise ValueError(f"{label}: {len(value)} entries; {_MOST} are allowed")
    return tuple(
        from_mapping(kind, each, f"{label}[{number}].", sizes) for number, each in enumerate(value)
    )


def _numbers(value: Any, label: str, count: int) -> tuple[float, ...]:
    good = isinstance(value, list) and len(value) == count
    if not good or not all(type(number) in (int, float) for number in value):
        raise ValueError(f"{label}: a list of {count} numbers is wanted")
    return tuple(_double(number, label) for number in value)


def _double(value: float, label: str) -> float:
    try:
        return float(value)
    except OverflowError:
        raise ValueError(f"{label} = {quoted(value)}: a finite number is wanted") from None
