# SPDX-License-Identifier: Apache-2.0
"""The deadline meter belongs to the hot loop: diagnostics, in another thread, never ask it.

Asked there, it forgets old ticks while the loop does the same; that once ended `manus` in a soak.
"""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import screw_module_ros.nodes as nodes

METER = {"tick", "rate", "latency", "missed_in_a_row"}
FILES = [
    file
    for file in sorted(Path(nodes.__file__).parent.glob("*.py"))
    if ".meter" in file.read_text(encoding="utf-8")
]


@pytest.mark.parametrize("file", FILES, ids=lambda path: path.stem)
def test_health_does_not_ask_the_meter(file):
    for function in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(function, ast.FunctionDef) and function.name == "health":
            called = {
                node.func.attr
                for node in ast.walk(function)
                if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)
            }
            assert not called & METER
