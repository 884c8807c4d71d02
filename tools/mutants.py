# SPDX-License-Identifier: Apache-2.0
"""Mutation score of a room: how many single wrong changes of its code the tests of it notice.

    tools/run python tools/mutants.py control --count 60 --seed 1 --json scores.json

Changes one comparison, sign, constant, condition or statement at a time, sampled with a fixed seed,
in a copy of the checkout, and runs the tests that call the changed function, the quickest first,
until one fails. `called.py` finds out once which test calls what; tests marked `long` judge no
change. A change that no test notices survives; it is printed with its place. The checkout itself is
never changed. With `--json` every change is kept with its killer, the first test that failed.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import copy
import itertools
import json
import os
import random
import select
import shutil
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, NoReturn

import can  # noqa: F401 (this and the next ones: a child has them already)
import hypothesis  # noqa: F401
import numba  # noqa: F401
import numpy  # noqa: F401
import pytest

import isolation

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = "screw_module_ros"
LONGEST_S = 3600.0
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
    "identification": ["test/identification"],
}
"""Tests that judge a room."""
DECLARED = "test/test_kept_settings.py"
"""Judges what stands outside of all functions, such as defaults and bounds of settings."""
ENOUGH_S = 60.0
"""Tests of this duration in all judge a change; slower ones judge none."""
_QUICK_S = 0.05
_HANGS_S = 60.0

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


def sampled(tree: Path, room: str, count: int, seed: int) -> list[Mutant]:
    """Return `count` changes of a room in a tree, the same ones for the same seed and code."""
    found = [
        one
        for path in sorted((tree / PACKAGE / room).rglob("*.py"))
        for one in mutants(path, str(path.relative_to(tree)))
    ]
    return random.Random(seed).sample(found, min(count, len(found)))


class Judges:
    """The tests of some rooms in a copy of the checkout, and what each of them calls."""

    def __init__(self, tree: Path, rooms: list[str]):
        """Run all of them once; raises ValueError when one fails without any change."""
        self._tree = tree
        out = tree / "called.json"
        os.environ.update(CALLED_IN=str(tree / PACKAGE), CALLED_OUT=str(out))
        folders = sorted({DECLARED, *(folder for room in rooms for folder in TESTS[room])})
        if failed := self._first_failure(
            ["-p", "called", "-m", "not long and not fault", *folders], LONGEST_S
        ):
            raise ValueError(f"{failed} fails without any change")
        found = json.loads(out.read_text(encoding="utf-8"))
        self._seconds = {test: each["seconds"] for test, each in found.items()}
        self._caught: Counter[str] = Counter()
        self._called = {
            test: {(file, line) for file, line in each["called"]} for test, each in found.items()
        }

    def killer(self, one: Mutant, room: str) -> str:
        """Return the first test that fails with a change, empty when none notices it."""
        file, tests = self._tree / one.path, self._of(one, room)
        source, stat = file.read_bytes(), file.stat()
        file.write_bytes(source[: one.begin] + one.text.encode() + source[one.end :])
        names = self._tree / "tests.txt"
        names.write_text("\n".join(tests), encoding="utf-8")
        longest_s = _HANGS_S + 5.0 * sum(self._seconds[test] for test in tests)
        try:
            killer = self._first_failure([f"@{names}"], longest_s) if tests else ""
        finally:
            file.write_bytes(source)
            os.utime(file, ns=(stat.st_atime_ns, stat.st_mtime_ns))  # for the compiled code's cache
        self._caught[killer] += 1
        return killer

    def _of(self, one: Mutant, room: str) -> list[str]:
        """Return the tests for a change, as many as the time allows.

        The room's own tests come first, of them the quick ones, and of equally quick ones those
        that call much and have caught other changes.

        Where none calls the function itself, as outside of all functions and in compiled code,
        these are the tests that call a function of the file, or else all of the room. Outside of
        all functions those of what is declared come first.
        """
        file = str(self._tree / one.path)
        line = _function_at(Path(file), one.line)
        own = {
            test: called
            for test, called in self._called.items()
            if test.startswith(tuple(f"{folder}/" for folder in TESTS[room]))
        }
        exact = [test for test, called in own.items() if (file, line) in called]
        near = [test for test, called in own.items() if any(f == file for f, _ in called)]
        chosen, spent = [], 0.0
        if not line:
            chosen = [test for test in self._called if test.startswith(DECLARED)]
        candidates = sorted(exact or near or own, key=self._cost)
        candidates.sort(key=lambda test: not test.startswith(f"{TESTS[room][0]}/"))
        for test in candidates:
            spent += self._seconds[test]
            if spent > ENOUGH_S:
                break
            chosen.append(test)
        return chosen

    def _cost(self, test: str) -> tuple[bool, float]:
        seconds = self._seconds[test]
        worth = (1 + self._caught[test]) * (1 + len(self._called[test]))
        return seconds > _QUICK_S, seconds / worth

    def _first_failure(self, arguments: list[str], longest_s: float) -> str:
        """Run pytest in a child that has its libraries already; return the first failed test.

        Whatever it started is ended with it.
        """
        ours, theirs = os.pipe()
        child = os.fork()
        if child == 0:
            _be_pytest(self._tree, arguments, theirs)
        os.close(theirs)
        with os.fdopen(ours) as pipe:
            told = select.select([pipe], [], [], longest_s)[0]
            failed = pipe.read() if told else "hangs"
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)
        os.waitpid(child, 0)
        return failed


def _be_pytest(tree: Path, arguments: list[str], told: int) -> NoReturn:
    """Be pytest in the copy until the first failure, and write its name to a descriptor."""
    failed = "pytest itself"
    try:
        os.setsid()
        os.chdir(tree)
        with open(tree / "pytest.log", "w") as log:
            os.dup2(log.fileno(), 1)
            os.dup2(log.fileno(), 2)
        sys.path[:0] = [str(tree), str(tree / "tools")]
        os.environ["PYTHONPATH"] = f"{tree}:{tree / 'tools'}"
        first = FirstFailure()
        code = pytest.main(["-x", "-q", "--no-header", *arguments], plugins=[first])
        failed = first.name or ("" if code == 0 else f"pytest: {code!r}")
    finally:
        os.write(told, failed.encode())
        os._exit(0)


class FirstFailure:
    """A pytest plugin: the name of the first test that failed."""

    name = ""

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note a failed test."""
        if report.failed:
            self.name = self.name or report.nodeid

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """Note a file that cannot be imported."""
        if report.failed:
            self.name = self.name or report.nodeid


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
    parser.add_argument("--seed", type=int, nargs="+", default=[1], help="one sample for each")
    parser.add_argument("--json", type=Path, help="write every change and its fate here")
    given = parser.parse_args()
    fates = []
    with tempfile.TemporaryDirectory() as folder, isolation.own_domain() as domain:
        tree = Path(folder, "tree")
        skipped = shutil.ignore_patterns(".git", ".venv", "build", "install", "log", "demo_output*")
        shutil.copytree(ROOT, tree, ignore=skipped)
        os.environ.update(isolation.variables(domain))
        os.environ.update(
            PYTHONDONTWRITEBYTECODE="1", PYTEST_DISABLE_PLUGIN_AUTOLOAD="1",
            XDG_CACHE_HOME=str(Path(folder, "cache")),  # each change has compiled code of its own
        )  # fmt: skip
        try:
            judges = Judges(tree, given.rooms)
        except ValueError as error:
            parser.error(f"{error}\n{(tree / 'pytest.log').read_text(encoding='utf-8')[-3000:]}")
        for room, seed in itertools.product(given.rooms, given.seed):
            chosen = sampled(tree, room, given.count, seed)
            survived = 0
            for one in chosen:
                killer = judges.killer(one, room)
                survived += not killer
                fates.append({"room": room, "seed": seed, "killer": killer, **one._asdict()})
                if not killer:
                    print(f"survived: {one.path}:{one.line}: {one.what}", flush=True)
                if given.json:
                    given.json.write_text(json.dumps(fates, indent=1), encoding="utf-8")
            caught = len(chosen) - survived
            share = 100 * caught / len(chosen)
            print(
                f"{room}, seed {seed}: {caught} of {len(chosen)} caught, {share:.0f} %", flush=True
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
