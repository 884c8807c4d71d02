# SPDX-License-Identifier: Apache-2.0
"""Checks the ROS arguments of this process that ROS 2 does not check.

Here `-p NODE:NAME:=VALUE` sets a parameter of the node NODE in any namespace, and the command line
overrides every file. rcl matches NODE in the root namespace only and lets a file's own section
override `-p NAME:=VALUE`, without a message in either case.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from typing import Any, NamedTuple

from rclpy.parameter import Parameter

from screw_module_ros.settings import SettingError, parse, shown

from .parameters import ParameterError

_FILE = ("--params-file",)
_PARAMETER = ("-p", "--param")
_REMAP = ("-r", "--remap")
_WITH_VALUE = (
    *_FILE, *_PARAMETER, *_REMAP, "-e", "--enclave", "--log-level", "--log-config-file",
    "--log-file-name",
)  # fmt: skip
_HELP = ("-h", "--help")
_RULE = re.compile(r"(?:(?P<node>\w+):)?(?P<name>[^:=]+):=(?P<value>.*)", re.DOTALL)
_NAME_RULE = re.compile(r"(?:(?P<node>\w+):)?__(?:node|name):=(?P<name>\w+)")
# YAML 1.1, and so PyYAML, takes 1e-3 for a string, rcl for a number.
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+")


class Rule(NamedTuple):
    """One `-p`: name of its node (empty for any), name of the parameter, value as text."""

    node: str
    name: str
    value: str


class Arguments(NamedTuple):
    """Content of a command line.

    files: parameter files, in order. rules: those of -p, in order. names: node name -> new name by
    `__node`, key "" for any node. others: arguments that are not for ROS.
    """

    files: tuple[str, ...] = ()
    rules: tuple[Rule, ...] = ()
    names: tuple[tuple[str, str], ...] = ()
    others: tuple[str, ...] = ()


def arguments(words: Sequence[str] | None = None) -> Arguments:
    """Return the parsed command line; words: without the program, None for this process's."""
    left = list(sys.argv[1:] if words is None else words)
    files, rules, names, others = [], [], [], []
    ours = False
    while left:
        word = left.pop(0)
        if not ours:
            ours = word == "--ros-args"
            if not ours:
                others.append(word)
        elif word == "--":
            ours = False
        elif word in _WITH_VALUE and left:
            value = left.pop(0)
            if word in _FILE:
                files.append(value)
            elif word in _PARAMETER and (found := _RULE.fullmatch(value)):
                rules.append(Rule(found["node"] or "", found["name"], found["value"]))
            elif word in _REMAP and (found := _NAME_RULE.fullmatch(value)):
                names.append((found["node"] or "", found["name"]))
    return Arguments(tuple(files), tuple(rules), tuple(names), tuple(others))


def overrides(name: str, args: Arguments) -> list[Parameter]:
    """Return the values that the command line sets for the node `name`."""
    for node, new in args.names:
        if node in ("", name):
            name = new
            break
    values = {rule.name: rule.value for rule in args.rules if not rule.node}
    values |= {rule.name: rule.value for rule in args.rules if rule.node == name}
    return [_parameter(key, text) for key, text in values.items()]


def asks_for_help(args: Arguments) -> bool:
    """Return whether the command line asks how the program is used."""
    return any(word in _HELP for word in args.others)


def usage(program: str) -> str:
    """Return how a node's executable is used."""
    return (
        f"usage: {program} [--ros-args -p NAME:=VALUE --params-file FILE -r __ns:=/NAMESPACE]\n\n"
        "Part of the therapy robot, until Ctrl-C; it takes ROS arguments alone. While it runs,\n"
        "`ros2 param list` names its parameters, and `ros2 param describe /NODE NAME` says what\n"
        "one means, in which unit and range."
    )


def check_others(args: Arguments) -> None:
    """Raise ParameterError for arguments that no node reads."""
    if args.others:
        raise ParameterError(
            f"unknown arguments: {' '.join(args.others)}; a node takes ROS arguments alone, like "
            "--ros-args -p NAME:=VALUE --params-file FILE"
        )


def _parameter(name: str, text: str) -> Parameter:
    value = _value(name, text)
    try:
        return Parameter(name, value=value)
    except (TypeError, ValueError) as error:
        raise ParameterError(f"parameter {name} = {shown(text)}: {error}") from None


def _value(name: str, text: str) -> Any:
    try:
        value = parse(text, f"parameter {name} = {shown(text)}")
    except SettingError as error:
        raise ParameterError(str(error)) from None
    if isinstance(value, list):
        return [_number(part) for part in value]
    return "" if value is None else _number(value)


def _number(value: Any) -> Any:
    return float(value) if isinstance(value, str) and _NUMBER.fullmatch(value) else value
