# SPDX-License-Identifier: Apache-2.0
"""The ROS arguments of this process, where rcl decides otherwise than a user expects.

Here `-p NODE:NAME:=VALUE` sets a parameter of the node NODE in any namespace, and the command line
overrides every file. rcl matches NODE in the root namespace only and lets a file's own section
override `-p NAME:=VALUE`, without a message in either case.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from rclpy.parameter import Parameter

from screw_module_ros.settings import SettingError, shown
from screw_module_ros.settings_file import parse

NETWORK = "--network"
"""The word that opens a node, and each command of the graph, to other machines."""
PARTS = "--parts"
"""The word before the names, by comma, of the nodes that a shared process has."""
_RULE = re.compile(r"(?:(?P<node>\w+):)?(?P<name>[^:=]+):=(?P<value>.*)", re.DOTALL)


class Rule(NamedTuple):
    """One `-p`: name of its node (empty for any), name of the parameter, value as text."""

    node: str
    name: str
    value: str


class Arguments(NamedTuple):
    """Content of a command line.

    files: parameter files, in order. rules: those of -p, in order. others: arguments that are not
    for ROS. network: other machines may take part. parts: nodes of this process, empty for those
    of the table.
    """

    files: list[str]
    rules: list[Rule]
    others: list[str]
    network: bool = False
    parts: tuple[str, ...] = ()


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
    others = [word for word in found.others if word != NETWORK]
    parts: tuple[str, ...] = ()
    if PARTS in others[:-1]:
        at = others.index(PARTS)
        parts = tuple(others.pop(at + 1).split(","))
        others.pop(at)
    return found._replace(others=others, network=NETWORK in found.others, parts=parts)


def overrides(name: str, rules: Iterable[Rule]) -> list[Parameter]:
    """Return the values that rules of -p set for the node `name`. Raises SettingError."""
    values = {rule.name: rule.value for rule in rules if not rule.node}
    values |= {rule.name: rule.value for rule in rules if rule.node == name}
    return [_parameter(key, text) for key, text in values.items()]


def _parameter(name: str, text: str) -> Parameter:
    label = f"parameter {name} = {shown(text)}"
    value = parse(text, label, for_ros=True)
    try:
        return Parameter(name, value="" if value is None else value)
    except (TypeError, ValueError) as error:
        raise SettingError(f"{label}: {error}") from None
