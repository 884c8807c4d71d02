# SPDX-License-Identifier: Apache-2.0
"""The one reader of all files and texts that hold settings.

Files are wrong by mistake: one sentence names the file, the key and what is wrong.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from .settings import SettingError, read, shown

VERSION = 1
"""Version of the files with a `format`, where the reader names no other."""


class _Loader(yaml.SafeLoader):  # type: ignore[misc]
    """Refuses a key that is written twice, and takes a date for text, as rcl does."""

    yaml_implicit_resolvers = {
        first: [pair for pair in pairs if pair[0] != "tag:yaml.org,2002:timestamp"]
        for first, pairs in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        keys = [self.construct_object(key) for key, _ in node.value]
        for n, (key, _) in enumerate(node.value):
            if keys[n] in keys[:n]:
                text = f"key {shown(keys[n])} is written twice"
                raise yaml.constructor.ConstructorError(None, None, text, key.start_mark)
        return super().construct_mapping(node, deep)


class _RosLoader(_Loader):
    """Takes 1e-3 for a number too, as rcl; YAML 1.1 wants a point before e and a sign after it.

    For what is written for ROS alone: PyYAML itself writes the text 1e5, of a digest maybe, so.
    """


_RosLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"), "-+.0123456789"
)


def parse(text: str, where: str, for_ros: bool = False) -> Any:
    """Return the content of a YAML text: mappings, lists, text, numbers, bools and None.

    where: its name in messages. for_ros: 1e-3 is a number. Raises SettingError with the line.
    """
    try:
        return yaml.load(text, _RosLoader if for_ros else _Loader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        line = f" in line {mark.line + 1}" if mark else ""
        reason = getattr(error, "problem", None) or error
        raise SettingError(f"{where} is no YAML: {' '.join(str(reason).split())}{line}") from None


def read_text(path: str | Path) -> str:
    """Return the text of a file. Raises SettingError naming it."""
    try:
        return Path(path).read_bytes().decode("utf-8")
    except (OSError, ValueError) as error:  # ValueError: no UTF-8, or no path
        reason = getattr(error, "strerror", None) or error
        raise SettingError(f"{path} cannot be read: {reason}") from None


def load(path: str | Path, for_ros: bool = False) -> Any:
    """Return the content of a YAML file, like `parse`.

    Raises SettingError naming file, line and problem.
    """
    return parse(read_text(path), str(path), for_ros)


def read_file(
    path: str | Path, kind: type, form: str = "", version: int = VERSION,
    renewed: Callable[[Any], Any] = lambda content: content,
) -> Any:  # fmt: skip
    """Return a YAML file as the record `kind`.

    form, version: wanted values of the file's keys of these names; form is empty for a file without
    them. renewed: makes the rest of a file of an earlier version that of this one. Raises
    SettingError naming the file, the key and the problem.
    """
    content = load(path)
    if form and isinstance(content, dict):
        found = content.pop("format", None), content.pop("version", None)
        if found != (form, version) or isinstance(found[1], bool):  # True equals 1
            raise SettingError(
                f"{path}: format = {shown(found[0])} and version = {shown(found[1])}: "
                f"{form!r} and {version} are wanted"
            )
    try:
        return read(kind, renewed(content))
    except SettingError as error:
        raise SettingError(f"{path}: {error}") from None
