# SPDX-License-Identifier: Apache-2.0
"""The clock rule: time is taken from `clock.py`, and nowhere else in the graph.

A loop, driver or guard that reads the system's clock would go on when simulated time stands. Code
for processes, terminals and disks is exempt, by name and with its reason.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import rules

TAKES_TIME = ("monotonic", "monotonic_ns", "sleep", "perf_counter", "perf_counter_ns")
EXEMPT = {
    "clock.py": "is the clock",
    "lockstep/conductor.py": "paces simulated time, gives up members that hang",
    "lockstep/member.py": "tells that simulated time stands still",
    "recording/recorder.py": "flushes to the disk",
    "nodes/bringup.py": "starts and ends processes",
    "trials/runner.py": "tells the user how long it took",
    "trials/demo.py": "tells the user how long it took",
    "trials/bench.py": "measures how fast the in-process loop is",
    "identification/reproduce.py": "tells the user how long it took",
}


def violations(package: Path) -> Iterator[str]:
    """Yield `file:line: reason` for each use of the system's clock that is not exempt."""
    for file in sorted(package.rglob("*.py")):
        name = file.relative_to(package).as_posix()
        if name in EXEMPT:
            continue
        for line, used in uses(ast.parse(file.read_text("utf-8"), str(file))):
            yield f"{file}:{line}: {used}: take the time from the clock handed in (clock.py)"


def uses(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield line and name of each mention of the system's clock."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            if node.value.id == "time" and node.attr in TAKES_TIME:
                yield node.lineno, f"time.{node.attr}"
        elif isinstance(node, ast.ImportFrom) and node.module == "time" and not node.level:
            for alias in node.names:
                if alias.name in TAKES_TIME:
                    yield node.lineno, f"from time import {alias.name}"


def main() -> int:
    """Check the package beside this folder; return the exit code."""
    gone = [name for name in EXEMPT if not (rules.FOLDER / name).exists()]
    found = [*violations(rules.FOLDER), *(f"tools/clock_rule.py: {name} is gone" for name in gone)]
    return rules.verdict(found, "Clock rule: time comes from one place.")


if __name__ == "__main__":
    sys.exit(main())
