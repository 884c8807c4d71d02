# SPDX-License-Identifier: Apache-2.0
"""Message definitions in rosbag2's form: the .msg text with all its dependencies.

The texts come from `share/PACKAGE/msg` of the prefixes in AMENT_PREFIX_PATH; the layout (a line of
80 `=`, `MSG: package/Type`, the text) is what rosbag2, rosbags, mcap and Foxglove parse.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

_TYPE_NAME = re.compile(r"(\w+)/(?:msg/)?(\w+)")
_FIELD_TYPE = re.compile(r"^[ \t]*([A-Za-z][\w/]*)(?:<=\d+)?(?:\[[^\]]*\])?[ \t]+\w", re.MULTILINE)
_PRIMITIVES = {"bool", "byte", "char", "float32", "float64", "string", "wstring"} | {
    f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)
}
_SEPARATOR = "=" * 80


class DefinitionError(LookupError):
    """A message type whose definition is not installed; the message names it."""


class Definition(NamedTuple):
    """Content of a schema record.

    encoding: `ros2msg`, empty if the type's text is unknown.
    text: the definition with all its dependencies.
    type_hash: RIHS01 hash of the type, empty if unknown.
    """

    encoding: str
    text: str
    type_hash: str


UNKNOWN = Definition("", "", "")


class Definitions:
    """Finds definitions of installed packages."""

    def __init__(self, packages: Mapping[str, Path] | None = None):
        """Search `packages` (name -> folder with msg/), then AMENT_PREFIX_PATH."""
        self._packages = dict(packages or {})

    def find(self, type_name: str) -> Definition:
        """Return the full definition of `pkg/msg/Type`.

        Raises DefinitionError if its package or that of a dependency is not installed.
        """
        text, seen = self._file(type_name, "msg"), {type_name}
        try:
            hashes = json.loads(self._file(type_name, "json"))["type_hashes"]
        except (DefinitionError, ValueError, KeyError):
            hashes = []
        found = [entry["hash_string"] for entry in hashes if entry["type_name"] == type_name]
        parts = [text, *self._dependencies(text, type_name, seen)]
        return Definition("ros2msg", "".join(parts), found[0] if found else "")

    def _dependencies(self, text: str, type_name: str, seen: set[str]) -> list[str]:
        """Return the parts of the types in `text` that are not in `seen`."""
        package, parts = type_name.split("/")[0], []
        named = set(_FIELD_TYPE.findall(text)) - _PRIMITIVES
        for name in sorted(name if "/" in name else f"{package}/{name}" for name in named):
            if name not in seen:
                seen.add(name)
                inner = self._file(name, "msg")
                parts.append(f"\n{_SEPARATOR}\nMSG: {name}\n{inner}")
                parts += self._dependencies(inner, name, seen)
        return parts

    def _file(self, type_name: str, ending: str) -> str:
        match = _TYPE_NAME.fullmatch(type_name)
        if match is None:
            raise DefinitionError(f"{type_name!r} is no message type: the form is package/msg/Type")
        package, base = match.groups()
        prefixes = filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep))
        shares = [Path(prefix, "share", package) for prefix in prefixes]
        for share in (self._packages.get(package), *shares):
            path = share and share / "msg" / f"{base}.{ending}"
            if path and path.is_file():
                return path.read_text(encoding="utf-8")
        raise DefinitionError(
            f"no definition of {type_name} in AMENT_PREFIX_PATH: source the workspace that has it"
        )


def fields(text: str) -> list[tuple[str, str]]:
    """Return (type, name) of the fields of a definition's first type, without constants."""
    own = text.split(f"\n{_SEPARATOR}\n", 1)[0]
    found = []
    for line in own.splitlines():
        words = line.split("#", 1)[0].split()
        if len(words) >= 2 and "=" not in line.split("#", 1)[0].replace("<=", ""):
            found.append((words[0], words[1]))
    return found
