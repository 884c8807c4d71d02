# SPDX-License-Identifier: Apache-2.0
"""Converts ROS messages to plain values for JSON and back, by the messages' field types.

It accepts any object with `get_fields_and_field_types()`, so it is independent of ROS. NaN and
infinite numbers become None in plain values; None is read as NaN.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

from ..settings import shown

_WHOLE = {
    f"{sign}int{bits}": (-(2 ** (bits - 1)) if not sign else 0, 2 ** (bits - (not sign)) - 1)
    for sign in ("", "u")
    for bits in (8, 16, 32, 64)
}
_FLOATS = ("float", "double")
_LIST = re.compile(r"sequence<(?P<of>.+?)(?:, (?P<most>\d+))?>|(?P<item>.+)\[(?P<count>\d+)\]")
_TEXT = re.compile(r"w?string(?:<(\d+)>)?")


class ConversionError(ValueError):
    """A value that does not fit its field; the message names field, value and what is wanted."""


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


def fill(message: Any, content: Any, make: Callable[[str], Any], where: str = "") -> Any:
    """Write plain values into a message's fields; return it. Fields not named keep their values.

    make: returns a new message of a type, as `package/Name`. where: name of the field that this
    message is, for errors. Raises ConversionError.
    """
    if not isinstance(content, dict):
        raise ConversionError(f"{where or 'the message'}: an object of field names is wanted")
    kinds = message.get_fields_and_field_types()
    for name, value in content.items():
        if name not in kinds:
            raise ConversionError(
                f"{_joined(where, shown(name))}: unknown field; known are {', '.join(kinds)}"
            )
        setattr(message, name, _value(kinds[name], value, make, _joined(where, name)))
    return message


def _joined(where: str, name: str) -> str:
    return f"{where}.{name}" if where else name


def _value(kind: str, value: Any, make: Callable[[str], Any], where: str) -> Any:
    if kind == "boolean":
        return _checked(value, isinstance(value, bool), where, "true or false")
    if kind in _FLOATS:
        return _number(value, where)
    if kind in _WHOLE:
        low, high = _WHOLE[kind]
        fits = type(value) is int and low <= value <= high
        return _checked(value, fits, where, f"a whole number from {low} to {high}")
    if text := _TEXT.fullmatch(kind):
        most = int(text[1]) if text[1] else math.inf
        return _checked(value, isinstance(value, str) and len(value) <= most, where, "a text")
    if found := _LIST.fullmatch(kind):
        return _items(found, value, make, where)
    if "/" in kind:
        return fill(make(kind), value, make, where)
    raise ConversionError(f"{where}: a field of type {kind} cannot be sent here")


def _items(found: re.Match, value: Any, make: Callable[[str], Any], where: str) -> list:
    count, most = found["count"], found["most"]
    wanted = f"a list of {count}" if count else f"a list of at most {most}" if most else "a list"
    _checked(value, isinstance(value, list), where, wanted)
    if count and len(value) != int(count) or most and len(value) > int(most):
        raise ConversionError(f"{where}: {wanted} is wanted, not one of {len(value)}")
    inner = found["of"] or found["item"]
    return [_value(inner, each, make, f"{where}[{at}]") for at, each in enumerate(value)]


def _number(value: Any, where: str) -> float:
    if value is None:
        return math.nan
    try:
        number = float(value) if type(value) in (int, float) else math.nan
    except OverflowError:
        number = math.inf
    _checked(value, math.isfinite(number), where, "a number or null")
    return number


def _checked(value: Any, fits: bool, where: str, wanted: str) -> Any:
    if not fits:
        raise ConversionError(f"{where} = {shown(value)}: {wanted} is wanted")
    return value
