# SPDX-License-Identifier: Apache-2.0
"""Mutation score of a room: how many single wrong changes of its code the tests of it notice.

    tools/run python tools/mutants.py control --count 60 --seed 1 --json scores.json

Changes one comparison, sign, constant, condition or statement at a time, sampled with a fixed seed,
in a copy of the checkout, and runs the tests that call the changed function, the quickest first,
until one fails (`called.py` finds out once which test calls what). A change that no test notices
survives; it is printed with its place. The checkout itself is never changed.
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
LONGEST_S = 900.0
TESTS = {
    "control": ["test/control", "test/properties", "test/loop"],
    "safety": ["test/safety", "test/properties", "test/loop"],
    "loop": ["test/loop", "test/properties"],
    "devices": ["test/devices", "test/loop"],
    "can_io": ["test/can_io", "test/devices"],
    "recording": ["test/recording"],
    "therapy": ["test/therapy"],
    "bridge": ["test/bridge"],
    "plant": ["test/plant"],
    "rig": ["test/rig", "test/loop"],
}
"""Tests that judge a room."""
_SLOWEST_S = 60.0
"""A test that takes longer alone judges no change."""

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


class Judges:
    """The tests of one room in a copy of the checkout, and what each of them calls."""

    def __init__(self, tree: Path, room: str, environment: dict[str, str]):
        """Run all of them once; raises ValueError when one fails without any change."""
        self._tree, self._environment = tree, environment
        out = tree / "called.json"
        watched = {"CALLED_IN": str(tree / PACKAGE / room), "CALLED_OUT": str(out)}
        self._environment = {**environment, "PYTHONPATH": f"{tree}:{tree / 'tools'}"}
        if self._fails(["-p", "called", *TESTS[room]], watched):
            raise ValueError(f"the tests of {room} fail without any change")
        found = json.loads(out.read_text(encoding="utf-8"))
        self._seconds = {test: each["seconds"] for test, each in found.items()}
        self._called = {
            test: {(file, line) for file, line in each["called"]} for test, each in found.items()
        }

    def notice(self, tests: list[str]) -> bool:
        """Return whether one of these tests fails in the copy as it is now."""
        names = self._tree / "tests.txt"
        names.write_text("\n".join(tests), encoding="utf-8")
        return bool(tests) and self._fails([f"@{names}"], {})

    def of(self, one: Mutant) -> list[str]:
        """Return the tests for a change, the quickest first.

        For a change outside of all functions these are all that call a function of the file.
        """
        file = str(self._tree / one.path)
        line = _function_at(Path(file), one.line)
        exact = [test for test, called in self._called.items() if (file, line) in called]
        near = [test for test, called in self._called.items() if any(f == file for f, _ in called)]
        chosen = exact if line else near or list(self._called)
        quick = [test for test in chosen if self._seconds[test] <= _SLOWEST_S]
        return sorted(quick, key=self._seconds.__getitem__)

    def _fails(self, arguments: list[str], more: dict[str, str]) -> bool:
        command = [sys.executable, "-m", "pytest", "-x", "-q", "--no-header", *arguments]
        try:
            done = subprocess.run(
                command, cwd=self._tree, env={**self._environment, **more}, capture_output=True,
                timeout=LONGEST_S, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return True
        return done.returncode != 0


def _function_at(file: Path, line: int) -> int:
    """Return the first line of the innermost function round a line, 0 outside of all."""
    found = 0
    for node in ast.walk(ast.parse(file.read_bytes())):
        if isinstance(node, ast.FunctionDef) and node.lineno <= line <= node.end_lineno:
            found = max(found, min([node.lineno, *(each.lineno for each in node.decorator_list)]))
    return found


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
            try:
                judges = Judges(tree, room, environment)
            except ValueError as error:
                parser.error(str(error))
            chosen = sampled(room, given.count, given.seed)
            survived = 0
            for one in chosen:
                file = tree / one.path
                source, tests = file.read_bytes(), judges.of(one)
                file.write_bytes(source[: one.begin] + one.text.encode() + source[one.end :])
                try:
                    caught = judges.notice(tests)
                finally:
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
