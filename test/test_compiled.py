# SPDX-License-Identifier: Apache-2.0
"""Compiled twins: same answers, a cache that notices changes, clear refusals."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy
import pytest

from screw_module_ros import compiled as module
from screw_module_ros.compiled import compiled, packed

pytestmark = pytest.mark.long

FACTOR = 3.0


class Inner(NamedTuple):
    weights: tuple
    count: int


class Outer(NamedTuple):
    inner: Inner
    gain: float


def weighed(p: Inner, x: float) -> float:
    return (p.weights[0] * x + p.weights[1]) * p.count


def law(p: Outer, x: float, on: bool) -> tuple[float, float]:
    if not on:
        return 0.0, 0.0
    return p.gain * weighed(p.inner, x), FACTOR * x


def packed_law(p, x: float, on: bool) -> tuple[float, float]:
    return law(p[0], x, on)


P = Outer(Inner((2.0, 1.0), 3), 0.5)


def test_twin_gives_the_same_and_the_function_stays_plain():
    twin = compiled(law)
    for x in (-1.5, 0.0, 2.0):
        assert twin(P, x, True) == law(P, x, True)
    assert twin(P, 1.0, False) == (0.0, 0.0)
    assert compiled(law) is twin
    assert not hasattr(weighed, "py_func")


def test_packed_parameters_give_the_same():
    array = packed(P)
    assert isinstance(array, numpy.ndarray)
    assert array[0]["inner"]["count"] == 3
    assert compiled(packed_law)(array, 2.0, True) == law(P, 2.0, True)


@dataclass
class Counter:
    step: Inner
    total: float = 0.0
    past: list = field(default_factory=lambda: [0.0, 0.0])


def counted(memory, x: float) -> float:
    memory.past[1] = memory.past[0]
    memory.past[0] = memory.total
    memory.total += weighed(memory.step, x)
    return memory.total


def counted_twin(packed_memory, x: float) -> float:
    return counted(packed_memory[0], x)


def test_a_dataclass_is_memory_that_a_twin_changes_in_place():
    plain = Counter(P.inner)
    twin, quick = packed(plain), compiled(counted_twin)
    for x in (-1.5, 0.0, 2.0):
        assert quick(twin, x) == counted(plain, x)
    assert twin[0]["total"] == plain.total
    assert list(twin[0]["past"]) == plain.past != [0.0, 0.0]


PROGRAM = """
import sys
sys.path[:0] = {path!r}
from outer import call
from screw_module_ros.compiled import compiled
twin = compiled(call)
print(twin(2.0), sum(twin.stats.cache_hits.values()))
"""
WITH_SCIPY = """
print("scipy" in sys.modules)
import scipy.linalg
"""


@pytest.fixture
def start(tmp_path):
    """Start a process that compiles `outer.call`, which calls `inner.double`."""
    (tmp_path / "inner.py").write_text("def double(x):\n    return 2.0 * x\n")
    (tmp_path / "outer.py").write_text(
        "from inner import double\n\ndef call(x):\n    return double(x) + 1.0\n"
    )
    root = Path(module.__file__).parents[1]
    program = PROGRAM.format(path=[str(tmp_path), str(root)])

    def starter(then="", **environment):
        return subprocess.Popen(
            [sys.executable, "-B", "-c", program + then],
            env={**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache"), **environment},
            stdout=subprocess.PIPE,
            text=True,
        )

    return starter


def answer(process):
    output, _ = process.communicate(timeout=100)
    assert process.returncode == 0
    return output.split()


def test_cache_is_shared_between_processes_and_notices_a_changed_callee(start, tmp_path):
    processes = [start(), start()]
    for process in processes:
        assert answer(process)[0] == "5.0"
    assert answer(start()) == ["5.0", "1"]
    (tmp_path / "inner.py").write_text("def double(x):\n    return 20. * x\n")
    assert answer(start()) == ["41.0", "0"]
    assert answer(start()) == ["41.0", "1"]


def test_no_scipy_is_loaded_for_it_and_none_is_hidden(start):
    """A simulated rig started a fifth of a second later, for a BLAS that nothing here calls."""
    assert answer(start(WITH_SCIPY)) == ["5.0", "0", "False"]


def test_home_that_cannot_be_written_is_no_obstacle(start, tmp_path):
    """The code is then compiled for this process alone, and nothing of it is left."""
    (tmp_path / "blocked").write_text("a file where a folder should be")
    before = set(tmp_path.iterdir())
    process = start(XDG_CACHE_HOME=str(tmp_path / "blocked"), TMPDIR=str(tmp_path))
    assert answer(process) == ["5.0", "0"]
    assert set(tmp_path.iterdir()) == before


def test_old_generations_are_removed(start, tmp_path):
    """A change of a source makes a new generation; the oldest of too many goes."""
    base = tmp_path / "cache" / module.PACKAGE / "compiled"
    for number in range(module.KEPT_FOLDERS):
        (base / f"{number}").mkdir(parents=True)
        os.utime(base / f"{number}", (number, number))
    assert answer(start())[0] == "5.0"
    kept = {folder.name for folder in base.iterdir()}
    assert len(kept) == module.KEPT_FOLDERS
    assert "0" not in kept
    assert "1" in kept


def test_a_record_that_holds_no_numbers_is_refused_in_a_sentence():
    with pytest.raises(module.NotCompiled, match="<object .*> is no number, and no NamedTuple"):
        packed(Inner((1.0,), object()))
