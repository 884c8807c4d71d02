# SPDX-License-Identifier: Apache-2.0
"""Assigns the sections of a parameter file to nodes, and finds those that no node reads.

ROS 2 ignores a section that matches no node and a file without values for a node, without a
message. A section `encoder:` matches only the node /encoder; `/**/encoder:` matches it in every
namespace.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from screw_module_ros.settings import SettingError, load

from .parameters import ParameterError

_PARAMETERS = "ros__parameters"
_WILD = ("*", "**")


class ParameterFile(NamedTuple):
    """A parameter file.

    path: as given. sections: full node name or pattern, like /left/encoder or /**/encoder -> its
    parameters, in the order of the file.
    """

    path: str
    sections: dict[str, Mapping[str, Any]]

    def own(self, node: str) -> list[str]:
        """Return the sections that match the node of this full name but not all nodes."""
        return [key for key in self.sections if not _is_for_all(key) and matches(key, node)]

    def shared(self, node: str) -> set[str]:
        """Return the parameters of `node` that only sections for all nodes, like /**, set."""
        fits = [key for key in self.sections if matches(key, node)]
        both = {
            for_all: {name for key in fits if _is_for_all(key) == for_all
                      for name in _flat(self.sections[key])}
            for for_all in (True, False)
        }  # fmt: skip
        return both[True] - both[False]


def read_file(path: str) -> ParameterFile:
    """Return the content of a file. Raises ParameterError naming the file and its problem."""
    try:
        content = load(path)
    except SettingError as error:
        raise ParameterError(f"parameter file {error}") from None
    sections: dict[str, Mapping[str, Any]] = {}
    _collect(path, content, "", sections)
    return ParameterFile(path, sections)


def _collect(path: str, content: Any, name: str, found: dict[str, Mapping[str, Any]]) -> None:
    if not isinstance(content, dict) or not content:
        place = f"{name!r} has" if name else "it has"
        raise ParameterError(
            f"parameter file {path}: {place} no `{_PARAMETERS}:`; a section begins with "
            f"`/**/encoder:` and, indented below it, `{_PARAMETERS}:`"
        )
    for key, part in content.items():
        if not str(key).strip("/"):
            raise ParameterError(f"parameter file {path}: a section in {name or '/'} has no name")
        if key != _PARAMETERS:
            _collect(path, part, f"{name}/{str(key).strip('/')}", found)
        elif not name:
            raise ParameterError(f"parameter file {path}: `{_PARAMETERS}:` outside of any node")
        elif not isinstance(part, dict):
            raise ParameterError(f"parameter file {path}: {name} has no values")
        elif any("" in full.split(".") for full in _flat(part)):
            raise ParameterError(f"parameter file {path}: a parameter in {name} has no name")
        else:
            found[name] = {**found.get(name, {}), **part}


def matches(pattern: str, node: str) -> bool:
    """Return whether a section's name matches a full node name: * is one part, ** any number."""
    expression = ""
    for part in pattern.strip("/").split("/"):
        expression += {"*": "/[^/]+", "**": "(?:/[^/]+)*"}.get(part, "/" + re.escape(part))
    return re.fullmatch(expression, node) is not None


def notices(files: Iterable[ParameterFile], node: str) -> list[str]:
    """Return a message for each file without values for the node of this full name."""
    warnings = []
    for file in files:
        if file.own(node):
            continue
        last = node.rpartition("/")[2]
        near = [key for key in file.sections if key.rpartition("/")[2] == last]
        hint = f"; write /**/{last}: in place of {_shown(near[0])}:" if near else ""
        warnings.append(f"{file.path} has no parameters for {node}{hint}")
    return warnings


def strangers(file: ParameterFile, nodes: Iterable[str], namespace: str = "") -> list[str]:
    """Return a message for each section that matches none of the nodes in a namespace.

    nodes: their names, without namespace.
    """
    nodes = list(nodes)
    above = "/" + namespace.strip("/") if namespace.strip("/") else ""
    warnings = []
    for key in file.sections:
        if _is_for_all(key) or any(matches(key, f"{above}/{node}") for node in nodes):
            continue
        last = key.rpartition("/")[2]
        close = difflib.get_close_matches(last, nodes, 1)
        hint = f"; /**/{close[0]}: is" if close else f"; there are {', '.join(nodes)}"
        warnings.append(f"{file.path}: {_shown(key)}: is no node of this robot{hint}")
    return warnings


def _shown(key: str) -> str:
    """Return a section's name as it is usually written."""
    return key if "*" in key else key.lstrip("/")


def _is_for_all(key: str) -> bool:
    return key.rpartition("/")[2] in _WILD


def _flat(values: Mapping[str, Any], above: str = "") -> list[str]:
    """Return the parameters' names; nested mappings are joined with dots, as rcl joins them."""
    names = []
    for name, value in values.items():
        full = f"{above}{name}"
        names += _flat(value, f"{full}.") if isinstance(value, dict) else [full]
    return names
