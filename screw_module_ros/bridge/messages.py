# SPDX-License-Identifier: Apache-2.0
"""ROS messages as JSON, and back from JSON's values.

NaN and infinite numbers are null in JSON. Null is read as NaN, and so is what a client does not
name where NaN leaves something alone (`LEFT_ALONE`). Of ROS it needs only what generated messages
offer: their fields' types, and the check of a value (`check_fields`).
"""

from __future__ import annotations

import json
import math
import re
from typing import Any

from ..graph import interface_class
from ..settings import shown

LEFT_ALONE = {"EndpointSetpoint": ("position",)}
"""Class -> its points in which, by its definition, NaN leaves an axis alone. An axis that JSON does
not name is NaN there: with ROS's default of 0 it would pull the hand to the floor."""

_LONGEST = 160  # characters of the reason why a value does not fit
_LIST = re.compile(r"sequence<(.+?)(?:, \d+)?>|(.+)\[\d+\]")


def plain(value: Any) -> Any:
    """Return a message, or the value of a field, as dictionaries, lists and plain values."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, (bool, int, str)):
        return value
    fields = getattr(value, "get_fields_and_field_types", None)
    if fields is not None:
        return {name: plain(getattr(value, name)) for name in fields()}
    if isinstance(value, bytes):  # one `octet`
        return value[0]
    if hasattr(value, "tolist"):  # array.array and numpy's
        value = value.tolist()
    return [plain(each) for each in value]


def as_json(message: Any) -> str:
    """Return a message as JSON."""
    return json.dumps(plain(message), allow_nan=False, separators=(",", ":"))


def filled(kind: type[Any], content: Any, where: str = "", unnamed: float | None = None) -> Any:
    """Return a message of a class with values from JSON; fields not named keep their defaults.

    In `LEFT_ALONE` they are NaN. where: name of the field that this message is, for errors.
    unnamed: value of its own numbers that are not named, None for their defaults. Raises
    ValueError, which names field, value and what is wanted.
    """
    if not isinstance(content, dict):
        raise ValueError(f"{where or 'the message'}: an object of field names is wanted")
    types = kind.get_fields_and_field_types()
    numbers = {} if unnamed is None else {n: unnamed for n, t in types.items() if t == "double"}
    message = kind(check_fields=True, **numbers)
    points = LEFT_ALONE.get(kind.__name__, ())
    content = {**{name: {} for name in points}, **content}
    for name, value in content.items():
        field = f"{where}.{name}".removeprefix(".")
        if name not in types:
            raise ValueError(f"{shown(field)}: unknown field; known are {', '.join(types)}")
        try:
            unnamed = math.nan if name in points else None
            setattr(message, name, _value(types[name], value, field, unnamed))
        except (AssertionError, OverflowError) as error:
            why = " ".join(str(error).split())[:_LONGEST]
            raise ValueError(f"{field} = {shown(value)}: {why}") from None
    return message


def _value(kind: str, value: Any, where: str, unnamed: float | None = None) -> Any:
    """Return a value from JSON as its field wants it; the message itself checks the rest.

    unnamed: as of `filled`, if the field is a message.
    """
    if found := _LIST.fullmatch(kind):
        if not isinstance(value, list):
            raise ValueError(f"{where} = {shown(value)}: a list is wanted")
        return [_value(found[1] or found[2], each, f"{where}[{i}]") for i, each in enumerate(value)]
    if "/" in kind:
        return filled(interface_class(kind), value, where, unnamed)
    if isinstance(value, bool) and kind != "boolean":  # Python takes True for 1
        raise ValueError(f"{where} = {value}: a {kind} is wanted")
    if kind in ("double", "float"):
        number = math.nan if value is None else float(value) if type(value) is int else value
        if isinstance(number, float) and math.isinf(number):
            raise ValueError(f"{where}: a finite number or null is wanted")
        return number
    return value
