# SPDX-License-Identifier: Apache-2.0
"""What other packages bring: objects found by entry point, files that lie beside their modules."""

from __future__ import annotations

import importlib
import importlib.util
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from .settings import SettingError


def load(path: str, group: str, what: str) -> Any:
    """Return the object `package.module:NAME`, or that of the group's entry point of this name.

    what: its kind for messages, like `law`. Raises SettingError when there is none.
    """
    points = entry_points(group=group)
    named = sorted({point.value for point in points if point.name == path})
    if len(named) > 1:
        raise SettingError(
            f"{what} {path}: several packages call one so ({', '.join(named)}): name the module"
        )
    module, colon, name = (named[0] if named else path).partition(":")
    if not colon:
        known = ", ".join(sorted(point.name for point in points)) or "none"
        raise SettingError(
            f"{what} {path}: neither package.module:NAME nor an entry point of {group}; "
            f"there: {known}"
        )
    try:
        return getattr(importlib.import_module(module), name)
    except (Exception, SystemExit) as error:  # somebody else's: anything may come out of it
        raise SettingError(f"{what} {path}: {type(error).__name__}: {error}") from None


def beside(module: str, name: str) -> Path:
    """Return the path of a file in the folder of a module or package, which is not run.

    Raises SettingError for a module that is not there.
    """
    try:
        spec = importlib.util.find_spec(module)
    except (Exception, SystemExit) as error:  # of a package above it, which is run
        raise SettingError(f"{module}:{name}: {type(error).__name__}: {error}") from None
    if spec is None or not spec.has_location or spec.origin is None:
        raise SettingError(f"{module}:{name}: there is no package {module}; is it installed?")
    return Path(spec.origin).parent / name


def settings_flaw(kind: Any) -> str:
    """Return why somebody's class of settings cannot be taken, empty if it can."""
    names = getattr(kind, "_fields", None)
    if names is None or not isinstance(kind, type):
        return "its settings are no NamedTuple"
    bare = sorted({*names} - {*getattr(kind, "_field_defaults", ())})
    return f"its setting {bare[0]} has no default" if bare else ""


def functions_flaw(given: Any, names: tuple[str, ...]) -> str:
    """Return that one of these attributes is no function, empty if all are."""
    no = [name for name in names if not callable(getattr(given, name))]
    return f"its {no[0]} is no function" if no else ""


def prefix_flaw(name: Any) -> str:
    """Return why a name cannot be the prefix of parameters, empty if it can."""
    if isinstance(name, str) and name.isidentifier() and name != "self":
        return ""
    return f"its name, {name!r}, is also the prefix of its parameters: use letters"
