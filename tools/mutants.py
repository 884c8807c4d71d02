# SPDX-License-Identifier: Apache-2.0
"""Mutation score of a room: how many single wrong changes of its code the tests of it notice.

    tools/run python tools/mutants.py control --count 60 --seed 1 --json scores.json

Changes one comparison, sign, constant, condition or statement at a time, sampled with a fixed seed,
in a copy of the checkout, and runs the tests of that room until the first fails. A change that no
test notices survives; it is printed with its place. The checkout itself is never changed.
"""

from __future__ import annotations

import argparse
import ast
import copy
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import isolation

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = "screw_module_ros"
LONGEST_S = 600.0
_QUICK_LOOP = ["test/loop", "-m", "not long"]
TESTS = {
    "control": [["test/control"], ["test/properties"]],
    "safety": [
        ["test/safety"], ["test/properties"], _QUICK_LOOP, ["test/loop", "-m", "long"],
    ],
    "loop": [_QUICK_LOOP, ["test/properties"], ["test/loop", "-m", "long"]],
    "devices": [["test/devices"], _QUICK_LOOP],
    "can_io": [["test/can_io", "test/devices"]],
    "recording": [["test/recording"]],
    "therapy": [["test/therapy"]],
    "plant": [["test/plant"]],
    "rig": [["test/rig"], _QUICK_LOOP],
}
"""Pytest calls that judge a room, in this order."""

_SWAPPED = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.And: ast.Or,
    ast.Or: ast.And, ast.FloorDiv: ast.Mult, ast.Mod: ast.Mult, ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd, ast.LShift: ast.RShift, ast.RShift: ast.LShift,
}  # fmt: skip
_DROPPED = (ast.Assign, ast.AugAssign, ast.Raise, ast.Delete)


class Mutant(NamedTuple):
    """One change: place in the file (from, to), new text, description."""

    path: str
    line: int
    begin: int
    end: int
    text: str
    what: str


def mutants(path: Path, name: str) -> Iterator[Mutant]:
    """Yield every change of a file. name: of the file, for the report."""
    source = path.read_bytes()
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    for node in _executed(ast.parse(source)):
        begin = starts[node.lineno - 1] + node.col_offset
        end = starts[node.end_lineno - 1] + node.end_col_offset
        for new, what in _changes(node):
            yield Mutant(name, node.lineno, begin, end, new, what)


def _executed(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes that run: no annotations, docstrings, formatted texts or declarations."""
    for field, value in ast.iter_fields(tree):
        if field in {"annotation", "returns", "decorator_list"}:
            continue
        for child in value if isinstance(value, list) else [value]:
            if not isinstance(child, ast.AST) or isinstance(
                child, ast.JoinedStr | ast.Import | ast.ImportFrom
            ):
                continue
            if isinstance(child, ast.expr | ast.stmt):
                yield child
            yield from _executed(child)


def _changes(node: ast.AST) -> Iterator[tuple[str, str]]:
    if isinstance(node, ast.Compare | ast.BinOp | ast.BoolOp):
        operators = node.ops if isinstance(node, ast.Compare) else [node.op]
        for number, operator in enumerate(operators):
            if type(operator) in _SWAPPED:
                other = copy.deepcopy(node)
                swapped = _SWAPPED[type(operator)]()
                if isinstance(other, ast.Compare):
                    other.ops[number] = swapped
                else:
                    other.op = swapped
                yield (
                    f"({ast.unparse(other)})",
                    f"{type(operator).__name__} -> {type(swapped).__name__}",
                )
    elif isinstance(node, ast.Constant) and type(node.value) in {int, float, bool}:
        new = not node.value if type(node.value) is bool else node.value * 2 or 1
        yield repr(new), f"{node.value!r} -> {new!r}"
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
        yield f"({ast.unparse(node.operand)})", f"{type(node.op).__name__} dropped"
    elif isinstance(node, ast.If | ast.While):
        return
    elif isinstance(node, _DROPPED) or (
        isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)
    ):
        yield "pass", f"dropped: {ast.unparse(node)[:60]}"
    elif isinstance(node, ast.IfExp):
        yield f"({ast.unparse(node.orelse)})", "only its else"


def sampled(room: str, count: int, seed: int) -> list[Mutant]:
    """Return `count` changes of a room, the same ones for the same seed and code."""
    found = [
        one
        for path in sorted((ROOT / PACKAGE / room).rglob("*.py"))
        for one in mutants(path, str(path.relative_to(ROOT)))
    ]
    return random.Random(seed).sample(found, min(count, len(found)))


def noticed(tree: Path, room: str, environment: dict[str, str]) -> bool:
    """Return whether a test of the room fails in this tree."""
    for arguments in TESTS[room]:
        command = [sys.executable, "-m", "pytest", "-x", "-q", "--no-header", *arguments]
        try:
            done = subprocess.run(
                command, cwd=tree, env=environment, capture_output=True, timeout=LONGEST_S,
                check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return True
        if done.returncode:
            return True
    return False


def main() -> int:
    """Judge the rooms that are named; return 0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rooms", nargs="+", choices=sorted(TESTS))
    parser.add_argument("--count", type=int, default=50, help="changes sampled in each room")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, help="write every change and its fate here")
    given = parser.parse_args()
    fates = []
    with tempfile.TemporaryDirectory() as folder, isolation.own_domain() as domain:
        tree = Path(folder, "tree")
        skipped = shutil.ignore_patterns(".git", ".venv", "build", "install", "log", "demo_output*")
        shutil.copytree(ROOT, tree, ignore=skipped)
        environment = {**os.environ, **isolation.variables(domain), "PYTHONPATH": str(tree)}
        environment["PYTHONDONTWRITEBYTECODE"] = environment["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
        for room in given.rooms:
            if noticed(tree, room, environment):
                parser.error(f"the tests of {room} fail without any change")
            chosen = sampled(room, given.count, given.seed)
            survived = 0
            for one in chosen:
                file = tree / one.path
                source = file.read_bytes()
                file.write_bytes(source[: one.begin] + one.text.encode() + source[one.end :])
                caught = noticed(tree, room, environment)
                file.write_bytes(source)
                survived += not caught
                fates.append({"room": room, "caught": caught, **one._asdict()})
                if not caught:
                    print(f"survived: {one.path}:{one.line}: {one.what}", flush=True)
                if given.json:
                    given.json.write_text(json.dumps(fates, indent=1), encoding="utf-8")
            caught = len(chosen) - survived
            print(f"{room}: {caught} of {len(chosen)} caught, {100 * caught / len(chosen):.0f} %")
    return 0


if __name__ == "__main__":
    sys.exit(main())
