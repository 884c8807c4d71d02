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

from .errors import DefinitionError

_TYPE_NAME = re.compile(r"^(\w+)/(?:(msg|action)/)?(\w+)$")
_FIELD_TYPE = re.compile(r"^[ \t]*([A-Za-z][\w/]*)(?:<=\d+)?(?:\[[^\]]*\])?[ \t]+\w", re.MULTILINE)
_PRIMITIVES = {"bool", "byte", "char", "float32", "float64", "string", "wstring"} | {
    f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)
}
_SEPARATOR = "=" * 80
_FEEDBACK = "_FeedbackMessage"


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
    """Finds and caches definitions of installed packages."""

    def __init__(self, packages: Mapping[str, Path] | None = None):
        """Search `packages` (name -> folder with msg/), then AMENT_PREFIX_PATH."""
        self._packages = dict(packages or {})
        self._texts: dict[str, str] = {}

    def find(self, type_name: str) -> Definition:
        """Return the full definition of `pkg/msg/Type`.

        Raises DefinitionError if its package or that of a dependency is not installed.
        """
        package, _, _ = _split(type_name)
        parts = [self._text(type_name)]
        self._gather(parts[0], package, {type_name}, parts)
        return Definition("ros2msg", "".join(parts), self.type_hash(type_name))

    def _gather(self, text: str, package: str, seen: set[str], parts: list[str]) -> None:
        for name in sorted(_dependencies(text, package)):
            if name in seen:
                continue
            seen.add(name)
            inner = self._text(name)
            parts.append(f"\n{_SEPARATOR}\nMSG: {name}\n{inner}")
            self._gather(inner, name.split("/")[0], seen, parts)

    def _text(self, name: str) -> str:
        if name not in self._texts:
            self._read(name)
        return self._texts[name]

    def _read(self, name: str) -> None:
        package, kind, base = _split(name)
        if kind == "action":
            self._read_feedback(name, package, base)
            return
        path = self._share(package, name) / "msg" / f"{base}.msg"
        try:
            self._texts[name] = path.read_text(encoding="utf-8")
        except OSError as error:
            raise DefinitionError(f"no definition of {name}: {error}") from None

    def _read_feedback(self, name: str, package: str, base: str) -> None:
        """Derive the topic type of an action's feedback, which has no .msg file."""
        if not base.endswith(_FEEDBACK):
            raise DefinitionError(f"no definition of {name}: only an action's feedback is a topic")
        action = base.removesuffix(_FEEDBACK)
        path = self._share(package, name) / "action" / f"{action}.action"
        try:
            sections = re.split(r"^---\s*$", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
        except OSError as error:
            raise DefinitionError(f"no definition of {name}: {error}") from None
        inner = f"{package}/{action}_Feedback"
        self._texts[inner] = sections[2].lstrip("\n")
        self._texts[name] = f"unique_identifier_msgs/UUID goal_id\n{inner} feedback\n"

    def _share(self, package: str, name: str) -> Path:
        if package in self._packages:
            return self._packages[package]
        for prefix in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
            share = Path(prefix) / "share" / package
            if share.is_dir():
                return share
        raise DefinitionError(
            f"no definition of {name}: package {package} is in no prefix of AMENT_PREFIX_PATH; "
            "source the workspace that contains it"
        )

    def type_hash(self, name: str) -> str:
        """Return the RIHS01 hash from the type's installed description, empty without one.

        A running graph announces the hash, too (endpoint information).
        """
        package, kind, base = _split(name)
        folder = self._share(package, name) / (kind or "msg")
        try:
            hashes = json.loads((folder / f"{base}.json").read_text())["type_hashes"]
        except (OSError, ValueError, KeyError):
            return ""
        return next((entry["hash_string"] for entry in hashes if entry["type_name"] == name), "")


def _split(name: str) -> tuple[str, str, str]:
    match = _TYPE_NAME.match(name)
    if match is None:
        raise DefinitionError(f"{name!r} is not a message type: the form is package/msg/Type")
    return match[1], match[2] or "", match[3]


def _dependencies(text: str, package: str) -> set[str]:
    found = set()
    for name in _FIELD_TYPE.findall(text):
        if name not in _PRIMITIVES:
            found.add(name if "/" in name else f"{package}/{name}")
    return found


def fields(text: str) -> list[tuple[str, str]]:
    """Return (type, name) of the fields of a definition's first type, without constants."""
    own = text.split(f"\n{_SEPARATOR}\n", 1)[0]
    found = []
    for line in own.splitlines():
        words = line.split("#", 1)[0].split()
        if len(words) >= 2 and "=" not in line.split("#", 1)[0].replace("<=", ""):
            found.append((words[0], words[1]))
    return found
