# SPDX-License-Identifier: Apache-2.0
"""The one reader of parameter files of ROS. Without ROS, since `check_hardware` works without it.

rcl ignores a section of a file that matches no node. A section `encoder:` matches only the node
/encoder; `/**/encoder:` matches it in every namespace. Of several sections that match, the later
one in the file overrides the earlier ones, whatever they are called.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence
from typing import Any

from .settings import SettingError
from .settings_file import load

_PARAMETERS = "ros__parameters"
Sections = dict[str, dict[str, Any]]
"""Full name of a node, or a pattern like /**/encoder -> its parameters; nested names with dots."""


def sections(path: str) -> Sections:
    """Return the sections of a parameter file, in their order.

    Sections that lie in one another are one full name: `left:` with `encoder:` in it is
    /left/encoder. Raises SettingError for a file that cannot be read or has no section; rcl refuses
    a malformed one.
    """
    found: Sections = {}
    _collect(load(path, for_ros=True), "", found)
    if not found:
        raise SettingError(f"parameter file {path} has no section with `{_PARAMETERS}:`")
    return found


def _collect(content: Any, name: str, found: Sections) -> None:
    for key, part in content.items() if isinstance(content, dict) else ():
        if key == _PARAMETERS:
            found.setdefault(name, {}).update(_flat(part))
        else:
            _collect(part, f"{name}/{str(key).strip('/')}", found)


def _flat(values: Any, above: str = "") -> dict[str, Any]:
    """Return the values by name; nested mappings are joined with dots, as rcl joins them."""
    if not isinstance(values, dict):
        return {above.removesuffix("."): values}
    flat: dict[str, Any] = {}
    for name, part in values.items():
        flat.update(_flat(part, f"{above}{name}."))
    return flat


def matches(section: str, node: str) -> bool:
    """Return whether a section is for a node (full name): * is one part, ** any number."""
    expression = ""
    for part in section.strip("/").split("/"):
        expression += {"*": "/[^/]+", "**": "(?:/[^/]+)*"}.get(part, "/" + re.escape(part))
    return re.fullmatch(expression, node) is not None


def values_of(file: Sections, node: str) -> dict[str, Any]:
    """Return the parameters that a file gives to a node (full name), by name."""
    values: dict[str, Any] = {}
    for section, given in file.items():
        if matches(section, node):
            values.update(given)
    return values


def only_for_all(files: Iterable[Sections], node: str) -> set[str]:
    """Return the parameters that only sections for all nodes, like /**, give to a node."""
    names: dict[bool, set[str]] = {True: set(), False: set()}
    for file in files:
        for section in file:
            if matches(section, node):
                names[_is_for_all(section)] |= file[section].keys()
    return names[True] - names[False]


def above(namespace: str) -> str:
    """Return a namespace with one leading /, empty for the root: what stands before /NODE."""
    name = namespace.strip("/")
    return f"/{name}" if name else ""


def unread_sections(path: str, nodes: Sequence[str], namespace: str = "") -> list[str]:
    """Return a message for each section of a file that matches no node. Raises SettingError.

    nodes: their names without the namespace, which is given with leading /, empty for none.
    """
    warnings = []
    for section in sections(path):
        if _is_for_all(section) or any(matches(section, f"{namespace}/{node}") for node in nodes):
            continue
        close = difflib.get_close_matches(section.rpartition("/")[2], nodes, 1)
        hint = f"; /**/{close[0]}: is" if close else f"; there are {', '.join(nodes)}"
        written = section if "*" in section else section.lstrip("/")
        warnings.append(f"{path}: {written}: is no node of this robot{hint}")
    return warnings


def _is_for_all(section: str) -> bool:
    return section.rpartition("/")[2] in ("*", "**")
