# SPDX-License-Identifier: Apache-2.0
"""Protocols as YAML files: strict, as they decide forces on a patient.

A key that is missing, unknown or out of range is refused in one sentence that names it.
"""

from __future__ import annotations

import types
from pathlib import Path
from typing import Any, Union, get_args, get_origin, get_type_hints

from ..plain_yaml import PlainYamlError, load_plain_yaml
from ..quoting import named, quoted
from ..regular_file import read_regular
from ..resources import resource_path
from ..settings import declared, problem
from .protocol import Protocol

SHIPPED = ("evaluation", "clock_adaptive", "elevator", "reach_3d")
"""Protocols that come with the package."""
_MOST = 200  # entries of a list; aliases make many of a few bytes
_LARGEST = 100_000  # bytes; ours have a few thousand


class ProtocolError(ValueError):
    """A protocol file that cannot be used; the message names file, key and way out."""


def load_protocol(name: str | Path) -> Protocol:
    """Return a protocol: one that comes with the package by its name, or a YAML file by its path.

    Raises ProtocolError.
    """
    return parse_protocol(protocol_text(name), str(name))


def protocol_text(name: str | Path) -> str:
    """Return a protocol's YAML, name as in `load_protocol`. Raises ProtocolError."""
    file = resource_path(f"params/therapy/{name}.yaml") if str(name) in SHIPPED else Path(name)
    try:
        return read_regular(file, _LARGEST).decode("utf-8")
    except (OSError, UnicodeDecodeError):
        raise ProtocolError(
            f"no protocol {str(name)!r}: name a YAML file, or one of {', '.join(SHIPPED)}"
        ) from None


def parse_protocol(text: str, name: str) -> Protocol:
    """Return the protocol of a YAML text; name: for messages. Raises ProtocolError."""
    try:
        return read_protocol(load_plain_yaml(text, aliases=True))  # circuits repeat themselves
    except PlainYamlError as error:
        raise ProtocolError(f"protocol {name}: cannot be read as YAML: {error}") from None
    except ValueError as error:
        raise ProtocolError(f"protocol {name}: {error}") from None


def read_protocol(content: Any) -> Protocol:
    """Return the protocol of a file's content. Raises ValueError naming the key that is wrong."""
    return _section(Protocol, content, "").validated()


def _section(kind: type, content: Any, where: str) -> Any:
    if not isinstance(content, dict):
        raise ValueError(f"{where or 'the file'}: a mapping of names to values is wanted")
    hints = get_type_hints(kind)
    for key in content:
        if key not in hints:
            raise ValueError(f"{where}{named(key)}: unknown; known are {', '.join(hints)}")
    values = {}
    for name, hint in hints.items():
        if name in content:
            values[name] = _value(kind, name, hint, content[name], where)
        elif name not in kind._field_defaults:
            raise ValueError(f"{where}{name}: missing; add it, as in the protocols of the package")
    return kind(**values)


def _value(kind: type, name: str, hint: Any, value: Any, where: str) -> Any:
    label = f"{where}{name}"
    if get_origin(hint) in (Union, types.UnionType):
        if value is None:
            return None
        hint = next(each for each in get_args(hint) if each is not type(None))
    if hasattr(hint, "_fields"):
        return _section(hint, value, f"{label}.")
    if get_origin(hint) is tuple:
        return _items(hint, value, label)
    return _plain(kind, name, hint, value, label)


def _items(hint: Any, value: Any, label: str) -> tuple:
    inner = get_args(hint)
    if not isinstance(value, list) or not value:
        raise ValueError(f"{label}: a list is wanted")
    if len(value) > _MOST:
        raise ValueError(f"{label}: {len(value)} entries; {_MOST} are allowed")
    if inner[-1] is Ellipsis:
        return tuple(_section(inner[0], each, f"{label}[{n}].") for n, each in enumerate(value))
    numbers = [each for each in value if type(each) in (int, float)]
    if len(value) != len(inner) or len(numbers) != len(value):
        raise ValueError(f"{label} = {quoted(value)}: {len(inner)} numbers are wanted")
    return tuple(_float(each, label) for each in value)


def _plain(kind: type, name: str, hint: type, value: Any, label: str) -> Any:
    if hint is float and type(value) is int:
        value = _float(value, label)
    if type(value) is not hint:
        raise ValueError(f"{label} = {quoted(value)}: {hint.__name__} is wanted")
    field = declared(kind).get(name)
    wrong = problem(field, value, label) if field else ""
    if wrong:
        raise ValueError(wrong)
    return value


def _float(value: float, label: str) -> float:
    try:
        return float(value)
    except OverflowError:
        raise ValueError(f"{label} = {quoted(value)}: beyond what a number can be") from None
