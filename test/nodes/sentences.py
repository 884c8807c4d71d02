# SPDX-License-Identifier: Apache-2.0
"""The texts that the modules of the package may say, read from their source."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).parents[2] / "screw_module_ros"


def template(node: ast.expr) -> str:
    """Return a text, its variable parts as {}."""
    if isinstance(node, ast.JoinedStr):
        return "".join(map(template, node.values))
    return str(node.value) if isinstance(node, ast.Constant) else "{}"


def sentences(path: Path, least: int = 3) -> Iterator[str]:
    """Yield the texts of `least` words and more that a module may say.

    Neither docstrings nor what describes a setting nor what is for who changes the code.
    """
    tree = ast.parse(path.read_text(encoding="utf-8"))
    left_out: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr):  # docstrings
            left_out.add(id(node.value))
        if isinstance(node, ast.Assert):
            left_out.add(id(node.msg))
        if isinstance(node, ast.JoinedStr):
            left_out |= {id(value) for value in node.values}
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Setting":
            left_out |= {id(part) for part in ast.walk(node)}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr) or (
            isinstance(node, ast.Constant) and isinstance(node.value, str)
        ):
            text = template(node)
            if id(node) not in left_out and len(text.split()) >= least:
                yield text
