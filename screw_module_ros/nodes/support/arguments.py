# SPDX-License-Identifier: Apache-2.0
"""The ROS arguments of this process, where rcl decides otherwise than a user expects.

Here `-p NODE:NAME:=VALUE` sets a parameter of the node NODE in any namespace, and the command line
overrides every file. rcl matches NODE in the root namespace only and lets a file's own section
override `-p NAME:=VALUE`, without a message in either case.

rcl also ignores a section of a file that matches no node. A section `encoder:` matches only the
node /encoder; `/**/encoder:` matches it in every namespace.
"""

from __future__ import annotations

import difflib
import re
import sys
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from rclpy.parameter import Parameter

from screw_module_ros.settings import SettingError, shown
from screw_module_ros.settings_file import load, parse

_PARAMETERS = "ros__parameters"
_RULE = re.compile(r"(?:(?P<node>\w+):)?(?P<name>[^:=]+):=(?P<value>.*)", re.DOTALL)
# YAML 1.1, and so PyYAML, takes 1e-3 for a string, rcl for a number.
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+")


class Rule(NamedTuple):
    """One `-p`: name of its node (empty for any), name of the parameter, value as text."""

    node: str
    name: str
    value: str


class Arguments(NamedTuple):
    """Content of a command line.

    files: parameter files, in order. rules: those of -p, in order. others: arguments that are not
    for ROS.
    """

    files: list[str]
    rules: list[Rule]
    others: list[str]


def arguments(words: Sequence[str] | None = None) -> Arguments:
    """Return the parsed command line; words: without the program, None for this process's."""
    found = Arguments([], [], [])
    left = iter(sys.argv[1:] if words is None else words)
    for_ros = False
    for word in left:
        if word == "--ros-args" or (for_ros and word == "--"):
            for_ros = word == "--ros-args"
        elif not for_ros:
            found.others.append(word)
        elif word == "--params-file":
            found.files.append(next(left, ""))
        elif word in ("-p", "--param") and (rule := _RULE.fullmatch(next(left, ""))):
            found.rules.append(Rule(rule["node"] or "", rule["name"], rule["value"]))
    return found


def overrides(name: str, rules: Iterable[Rule]) -> list[Parameter]:
    """Return the values that rules of -p set for the node `name`. Raises SettingError."""
    values = {rule.name: rule.value for rule in rules if not rule.node}
    values |= {rule.name: rule.value for rule in rules if rule.node == name}
    return [_parameter(key, text) for key, text in values.items()]


def _parameter(name: str, text: str) -> Parameter:
    label = f"parameter {name} = {shown(text)}"
    value = parse(text, label)
    if isinstance(value, list):
        value = [_number(part) for part in value]
    try:
        return Parameter(name, value="" if value is None else _number(value))
    except (TypeError, ValueError) as error:
        raise SettingError(f"{label}: {error}") from None


def _number(value: Any) -> Any:
    return float(value) if isinstance(value, str) and _NUMBER.fullmatch(value) else value


def sections(path: str) -> dict[str, set[str]]:
    """Return the sections of a parameter file, each with the names of its parameters.

    A section is a full node name or a pattern, like /left/encoder or /**/encoder. Raises
    SettingError for a file that cannot be read or has no section; rcl refuses a malformed one.
    """
    found: dict[str, set[str]] = {}
    _collect(load(path), "", found)
    if not found:
        raise SettingError(f"parameter file {path} has no section with `{_PARAMETERS}:`")
    return found


def _collect(content: Any, name: str, found: dict[str, set[str]]) -> None:
    for key, part in content.items() if isinstance(content, dict) else ():
        if key == _PARAMETERS:
            found.setdefault(name, set()).update(_names(part))
        else:
            _collect(part, f"{name}/{str(key).strip('/')}", found)


def _names(values: Any, above: str = "") -> list[str]:
    """Return the parameters' names; nested mappings are joined with dots, as rcl joins them."""
    if not isinstance(values, dict):
        return [above.removesuffix(".")]
    return [full for name, part in values.items() for full in _names(part, f"{above}{name}.")]


def matches(section: str, node: str) -> bool:
    """Return whether a section is for a node (full name): * is one part, ** any number."""
    expression = ""
    for part in section.strip("/").split("/"):
        expression += {"*": "/[^/]+", "**": "(?:/[^/]+)*"}.get(part, "/" + re.escape(part))
    return re.fullmatch(expression, node) is not None


def only_for_all(files: Iterable[dict[str, set[str]]], node: str) -> set[str]:
    """Return the parameters that only sections for all nodes, like /**, give to a node."""
    names: dict[bool, set[str]] = {True: set(), False: set()}
    for file in files:
        for section in file:
            if matches(section, node):
                names[_is_for_all(section)] |= file[section]
    return names[True] - names[False]


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
