# SPDX-License-Identifier: Apache-2.0
"""The import rule: which layer of screw_module_ros may import what, checked on the source.

Only `nodes/` imports rclpy and messages, and nothing but `nodes/` imports `nodes/`. The plant
shares nothing with the controllers and drivers that are tried on it, nor the simulated devices with
the drivers: a shared formula or byte layout would agree with itself when it is wrong.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

PACKAGE = "screw_module_ros"
ROS_MODULES = ("rclpy", "rosgraph", "launch", "builtin_interfaces", "std_srvs", "rcl_interfaces")
ROS_SUFFIXES = ("_msgs", "_interfaces")
NODES = "nodes"
FORBIDDEN_LAYERS = {
    "plant": ("control", "devices", "rig"),
    "rig": ("control", "devices"),
    "devices": ("control", "plant", "rig"),
    "control": ("devices", "plant", "rig"),
    "geometry": ("control", "devices", "plant", "rig"),
    "filters": ("control", "devices", "plant", "rig"),
}
PURE_LAYERS = ("control", "plant", "geometry", "filters", "samples")
INPUT_OUTPUT = ("can", "canopen", "mcap", "rosbags", "socket", "select", "threading", "subprocess")


class Violation(NamedTuple):
    """An import that the rule forbids: where it is, and why."""

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
        for line, module in imported_modules(ast.parse(file.read_text("utf-8"), str(file)), parts):
            reason = verdict(parts[0], module)
            if reason:
                found.append(Violation(file, line, reason))
    return found


def verdict(layer: str, module: str) -> str:
    """Return why a file of this layer must not import the module, empty when it may."""
    top, *inner = module.split(".")
    if layer == NODES:
        return ""
    if top in ROS_MODULES or top.endswith(ROS_SUFFIXES):
        return f"only {NODES}/ imports ROS, not {layer}: {module}"
    if layer in PURE_LAYERS and top in INPUT_OUTPUT:
        return f"{layer} does no input or output: {module}"
    if top != PACKAGE or not inner:
        return ""
    if inner[0] == NODES:
        return f"nothing outside {NODES}/ imports it: {module}"
    if inner[0] in FORBIDDEN_LAYERS.get(layer, ()):
        return f"{layer} does not import {inner[0]}: {module}"
    return ""


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
    found = violations(Path(__file__).resolve().parent.parent / PACKAGE)
    for violation in found:
        print(violation, file=sys.stderr)
    if not found:
        print("Import rule: all layers keep to it.")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
