# SPDX-License-Identifier: Apache-2.0
"""Why an object of another package cannot be taken: each a sentence, empty if it can."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from .plugins import told
from .settings import SettingError, fields, validated

_LONGEST = 60  # characters of a name
_KINDS = (bool, int, float, str, tuple)

Kind = TypeVar("Kind")


def first_flaw(given: Any, *judges: Callable[[Any], str]) -> str:
    """Return the first flaw that a judge finds in what somebody brings, empty without one.

    What raises an error while it is looked at has one.
    """
    try:
        return next(filter(None, (judge(given) for judge in judges)), "")
    except BaseException as error:  # somebody else's: anything may come out of it
        return told(error)


def taken(given: Any, what: str, kind: type[Kind], *judges: Callable[[Any], str]) -> Kind:
    """Return what somebody brings. Raises SettingError if it is of another kind, or has a flaw.

    what: its kind and path for messages, like `law mylab:FLOOR`.
    """
    if not isinstance(given, kind):
        raise SettingError(f"{what}: it is no {kind.__module__}.{kind.__qualname__}")
    if wrong := first_flaw(given, *judges):
        raise SettingError(f"{what}: {wrong}")
    return given


def settings_flaw(kind: Any) -> str:
    """Return why somebody's class of settings cannot be taken, empty if it can."""
    names = getattr(kind, "_fields", None)
    if names is None or not isinstance(kind, type):
        return "its settings are no NamedTuple"
    if bare := sorted({*names} - {*getattr(kind, "_field_defaults", ())}):
        return f"its setting {bare[0]} has no default"
    made = validated(kind())
    for name, field in fields(kind).items():
        if not _is_name(name):
            return f"its setting {name!r} is the name of a parameter: use letters without accents"
        value = getattr(made, name)
        wanted = (field.kind,) if field.kind in _KINDS else _KINDS
        if type(value) not in wanted:
            return f"its setting {name} begins as {value!r}, no {wanted[0].__name__}"
        for text in (field.setting.text, field.setting.unit):
            text.encode()  # raises what no message can carry
    return ""


def functions_flaw(given: Any, names: tuple[str, ...]) -> str:
    """Return that one of these attributes is no function, empty if all are."""
    no = [name for name in names if not callable(getattr(given, name))]
    return f"its {no[0]} is no function" if no else ""


def prefix_flaw(name: Any) -> str:
    """Return why a name cannot be the prefix of parameters, empty if it can."""
    if _is_name(name) and name != "self":
        return ""
    return f"its name, {name!r}, is also the prefix of its parameters: use letters without accents"


def shown_flaw(names: Any, most: int) -> str:
    """Return why the names of what somebody shows cannot be taken, empty if they can."""
    if isinstance(names, tuple) and len(names) <= most and all(map(_is_name, names)):
        return "" if len({*names}) == len(names) else f"what it shows, {names!r}, has a name twice"
    return f"what it shows, {names!r}, is no tuple of {most} names at most"


def _is_name(name: Any) -> bool:
    """Return whether this is an identifier of ASCII characters, and not too long."""
    good = isinstance(name, str) and name.isidentifier() and name.isascii()
    return good and len(name) <= _LONGEST


def is_title(text: Any) -> bool:
    """Return whether this can stand as a name in messages and tables: short, printable."""
    return isinstance(text, str) and 0 < len(text) <= _LONGEST and text.isprintable()
