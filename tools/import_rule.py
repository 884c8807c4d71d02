# SPDX-License-Identifier: Apache-2.0
"""The import rule: which layer of screw_module_ros may import what, checked on the source.

Only `nodes/`, `operator/`, `trials/` and `identification/live/` import rclpy and messages, and
nothing but these imports one of them. The plant shares nothing with the controllers and drivers
that are tried on it, nor the simulated devices with the drivers: a shared formula or byte layout
would agree with itself when it is wrong. Laws and physics are pure: no files, no clock, no bus.

The rooms stand in one order, `ROOMS`, and import only what stands before them, so that no two
rooms import each other; inside a room no modules import each other in a circle.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import rules
from rules import PACKAGE

ROS_MODULES = ("rclpy", "rosgraph", "launch", "builtin_interfaces", "std_srvs", "rcl_interfaces")
ROS_SUFFIXES = ("_msgs", "_interfaces")
ROS_LAYERS = ("nodes", "operator", "trials", "identification/live")
SHARED = (
    "units", "domain", "resources", "settings", "samples", "geometry", "filters", "compiled",
    "figure_style", "graph", "profiles",
)  # fmt: skip
ROOMS = (
    *SHARED, "clock", "lockstep", "plant", "can_io", "rig", "safety", "control",
    "calibration", "devices", "loop", "recording", "identification", "therapy", "bridge",
    "hardware", "session_command",
    "nodes", "operator", "identification/live", "trials",
)  # fmt: skip
FORBIDDEN_LAYERS = {  # beside what their order forbids: the plant and the rig know no control, ...
    "plant": ("lockstep", "clock"),
    "safety": ("lockstep", "clock", "can_io", "plant", "rig"),
    "control": ("lockstep", "clock", "can_io", "plant", "rig"),
    "calibration": ("plant", "rig"),
    "devices": ("control", "calibration", "plant", "rig"),
    "loop": ("calibration", "plant", "rig"),
}
PURE_LAYERS = ("safety", "control", "plant", "geometry", "filters", "samples", "units", "graph")
FILE_READERS = ("load", "read_file", "read_text")  # of `settings`: no pure layer imports them
READS_ITS_PARAMETERS = ("plant/settings.py",)  # params/plant.yaml, before any physics
FILES = ("io", "os", "pathlib", "shutil", "tempfile", "yaml")
INPUT_OUTPUT = (
    "can", "canopen", "mcap", "rosbags", "socket", "select", "selectors", "socketserver", "ssl",
    "threading", "subprocess", "multiprocessing", "asyncio", "queue", "time", "datetime",
)  # fmt: skip
OPENERS = ("open", "print", "input")


class Violation(NamedTuple):
    """An import or a call that the rule forbids: where it is, and why."""

    file: Path
    line: int
    reason: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.reason}"


def violations(package: Path) -> list[Violation]:
    """Check every file of the package in this folder; return what breaks the rule."""
    found = []
    for file in sorted(package.rglob("*.py")):
        parts = file.relative_to(package).with_suffix("").parts
        tree = ast.parse(file.read_text("utf-8"), str(file))
        for line, module in imported_modules(tree, parts):
            reason = verdict(parts, module)
            if reason:
                found.append(Violation(file, line, reason))
        if parts[0] in PURE_LAYERS:
            reason = f"{parts[0]} does no input or output"
            found += [Violation(file, at, f"{reason}: {name}()") for at, name in opened(tree)]
    return [*found, *circles(package)]


def verdict(parts: tuple[str, ...], module: str) -> str:
    """Return why the file at `parts` must not import the module, empty when it may."""
    layer = parts[0]
    top, *inner = module.split(".")
    if ros_layer(parts):
        return upward(parts, tuple(inner), module) if top == PACKAGE and inner else ""
    if top in ROS_MODULES or top.endswith(ROS_SUFFIXES):
        return f"only {', '.join(ROS_LAYERS)} import ROS, not {layer}: {module}"
    if layer in PURE_LAYERS and not_pure(parts, module):
        return f"{layer} does no input or output: {module}"
    if top != PACKAGE or not inner:
        return ""
    if ros_layer(tuple(inner)):
        return f"nothing outside {', '.join(ROS_LAYERS)} imports these: {module}"
    if inner[0] in FORBIDDEN_LAYERS.get(layer, ()):
        return f"{layer} does not import {inner[0]}: {module}"
    return upward(parts, tuple(inner), module)


def upward(parts: tuple[str, ...], inner: tuple[str, ...], module: str) -> str:
    """Return why the file at `parts` must not import from a room that stands after its own."""
    own, other = room_of(parts), room_of(inner)
    for room in (own, other):
        if room not in ROOMS and room != "__init__":
            return f"{room} has no place in the order of rooms: add it to ROOMS in import_rule.py"
    if own == other or own == "__init__" or ROOMS.index(other) < ROOMS.index(own):
        return ""
    return f"{own} stands before {other} and does not import it: {module}"


def room_of(parts: tuple[str, ...]) -> str:
    """Return the room of what lies at `parts` of the package."""
    return "/".join(parts[:2]) if "/".join(parts[:2]) in ROOMS else parts[0]


def ros_layer(parts: tuple[str, ...]) -> bool:
    """Return whether what lies at `parts` of the package is one of the layers that know ROS."""
    return any(parts[: len(names)] == names for names in map(_names, ROS_LAYERS))


def _names(layer: str) -> tuple[str, ...]:
    return tuple(layer.split("/"))


def not_pure(parts: tuple[str, ...], module: str) -> bool:
    """Return whether a pure layer's file at `parts` must not import the module."""
    if module.partition(".")[0] in INPUT_OUTPUT:
        return True
    reads = "/".join(parts) + ".py" in READS_ITS_PARAMETERS
    reader = module in {f"{PACKAGE}.settings.{name}" for name in FILE_READERS}
    return not reads and (reader or module.partition(".")[0] in FILES)


def opened(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield line and name of each call that reaches a file or the terminal without an import."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            if node.func.id in OPENERS:
                yield node.lineno, node.func.id


def circles(package: Path) -> Iterator[Violation]:
    """Yield the modules that import each other in a circle, imports for types apart."""
    files = {_module(file.relative_to(package)): file for file in package.rglob("*.py")}
    imports = {
        name: sorted(_own_imports(file, file.relative_to(package)) & files.keys() - {name})
        for name, file in files.items()
    }
    done: set[str] = set()

    def follow(name: str, way: list[str]) -> Iterator[Violation]:
        if name in way:
            circle = " -> ".join([*way[way.index(name) :], name])
            yield Violation(files[name], 1, f"modules import each other in a circle: {circle}")
        elif name not in done:
            for other in imports[name]:
                yield from follow(other, [*way, name])
            done.add(name)

    for name in sorted(files):
        yield from follow(name, [])


def _own_imports(file: Path, place: Path) -> set[str]:
    """Return the names that a file imports from the package when it runs."""
    tree = ast.parse(file.read_text("utf-8"), str(file))
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            node.body = []
    found = [module for _, module in imported_modules(tree, place.with_suffix("").parts)]
    return {*found, *(module.rpartition(".")[0] for module in found)}


def _module(place: Path) -> str:
    parts = place.with_suffix("").parts
    return ".".join((PACKAGE, *(parts[:-1] if parts[-1] == "__init__" else parts)))


def imported_modules(tree: ast.AST, parts: tuple[str, ...]) -> Iterator[tuple[int, str]]:
    """Yield line and absolute name of each module that a file at `parts` imports, also inside
    functions. `from a import b` yields a.b, since b may be a module."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield node.lineno, alias.name
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                base = ".".join((*(PACKAGE, *parts)[: -node.level], base))
            for alias in node.names:
                yield node.lineno, f"{base.rstrip('.')}.{alias.name}"


def main() -> int:
    """Check the package beside this folder; return the exit code."""
    return rules.verdict(violations(rules.FOLDER), "Import rule: all layers keep to it.")


if __name__ == "__main__":
    sys.exit(main())
