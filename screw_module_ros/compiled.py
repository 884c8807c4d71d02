# SPDX-License-Identifier: Apache-2.0
"""Compiled twins of the pure functions of this package.

Laws and physics are plain Python functions of floats, ints, bools and NamedTuples of these; the
memory of a law is a dataclass. `compiled(function)` returns the same function as machine code
(numba, nopython), with the functions it calls compiled too. Source and plain function stay
unchanged, so the realtime node, the fast simulation and the tests run the same source.

The machine code is cached below the user's cache folder. The folder's name is a hash of the
sources, because numba's own cache does not detect a change of a called function. Processes may
share the folder. Where it cannot be written, each process compiles for itself.
"""

from __future__ import annotations

import contextlib
import fcntl
import functools
import hashlib
import importlib
import os
import re
import shutil
import sys
import types
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

PACKAGE = __name__.partition(".")[0]
KEPT_FOLDERS = 40  # compiled generations kept on disk, the oldest are removed first
_ROOT = Path(__file__).parent
# A division by zero gives inf or NaN, as in arrays. Functions that are called are part of their
# caller: passing records of twenty numbers takes a quarter of the plant's time.
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "forceinline": True}


class NotCompiled(ValueError):
    """A function that cannot become machine code, or a record that it cannot take."""


@contextlib.contextmanager
def compiling(what: str, *functions: Callable) -> Iterator[None]:
    """Say of `what` that it cannot be compiled, and in which line of the functions' files.

    Around the first call of a compiled function. Raises NotCompiled in place of numba's error.
    """
    from numba.core.errors import NumbaError

    try:
        yield
    except NumbaError as error:
        words = re.sub("\x1b\\[[0-9;]*m", "", str(error))  # without colours
        files = {Path(function.__code__.co_filename).name for function in functions}
        wheres = re.findall(r'(\S.*)\s*\n\s*File "(?:.*/)?(.+)", line (\d+)', words)
        found = [(why, file, line) for why, file, line in wheres if file in files]
        place = "{1}, line {2}: {0}; ".format(*found[0]) if found else ""
        raise NotCompiled(
            f"{what} cannot be compiled for a simulation: {place}it has to hold to numbers, to "
            "functions at the top of a module and to math"
        ) from None


@functools.cache
def compiled(function: Callable) -> Callable:
    """Return the compiled twin of a pure function.

    Functions it calls must be module-level functions imported by name (`from .friction import
    steady_level`), functions in its closure, such as those of a law in its envelope, or functions
    of `math`, and may not call themselves. A closure is compiled once if it is made once.
    Compilation happens at the first call with arguments of a new type (seconds), or is read from
    the disk cache (a fraction of one). Raises ImportError when numba is missing.
    """
    numba = _numba()
    from numba.extending import register_jitable

    callees = _reached(function) - {function}
    for callee in callees - _registered:
        register_jitable(**_OPTIONS)(callee)
    _registered.update(callees)
    twin: Any = numba.njit(**_OPTIONS)(function)
    if (folder := _cache_folder(callees | {function})) is not None:
        config: Any = numba.config
        before, config.CACHE_DIR = config.CACHE_DIR, str(folder)  # read on creation
        twin._cache = _locked_cache(function)
        config.CACHE_DIR = before
    return twin


_registered: set[Callable] = set()


@functools.cache
def _numba() -> Any:
    """Return numba, loaded without scipy where nobody has imported that yet.

    numba would import it, which takes a third of its start, to learn whether functions of arrays
    have a BLAS. What is compiled here computes with numbers.
    """
    hidden: dict[str, Any] = {} if "scipy" in sys.modules else {"scipy": None}
    sys.modules.update(hidden)
    try:
        importlib.import_module("numba.np.arraymath")
    finally:
        for name in hidden:
            del sys.modules[name]
    return sys.modules["numba"]


def packed(record: Any) -> Any:
    """Return a NamedTuple or a dataclass, nested ones too, as a numpy array with one element.

    A compiled function takes such an array in 0.2 us and a NamedTuple in 0.1 us per number. Its
    element has the record's attributes: `def twin(packed_p, x): return law(packed_p[0], x)`. Where
    the function sets one, the array changes, as the dataclass does in plain Python. A tuple or list
    of numbers becomes an array of floats. A word, a setting among choices, keeps its first 16
    characters; compiled functions cannot compute with it.
    """
    import numpy

    result = numpy.zeros(1, _dtype(record))
    result[0] = _plain(record)
    return result


def _names(value: Any) -> tuple[str, ...]:
    """Return the fields of a NamedTuple or a dataclass; none of anything else."""
    return getattr(value, "_fields", None) or tuple(getattr(value, "__dataclass_fields__", ()))


def _dtype(value: Any) -> Any:
    import numpy

    if names := _names(value):
        fields = [(name, _dtype(getattr(value, name))) for name in names]
        return numpy.dtype(fields, align=True)
    if isinstance(value, (tuple, list)):
        return numpy.dtype((numpy.float64, (len(value),)))
    if isinstance(value, str):
        return numpy.dtype("U16")  # whatever the word, so that another one compiles nothing anew
    kind = numpy.dtype(type(value))
    if kind.hasobject:
        raise NotCompiled(f"{value!r} is no number, and no NamedTuple or dataclass of numbers")
    return kind


def _plain(value: Any) -> Any:
    if names := _names(value):
        return tuple(_plain(getattr(value, name)) for name in names)
    return tuple(value) if isinstance(value, (tuple, list)) else value


def _reached(function: Callable) -> set[Callable]:
    """Return the functions that `function` reaches, by its module or its closure, itself too."""
    found, waiting = set(), [function]
    while waiting:
        current = waiting.pop()
        found.add(current)
        named = [current.__globals__.get(name) for name in current.__code__.co_names]
        named += [cell.cell_contents for cell in current.__closure__ or ()]
        waiting += [f for f in named if isinstance(f, types.FunctionType) and f not in found]
    return found


def _cache_folder(functions: set[Callable]) -> Path | None:
    """Return the folder of these sources' machine code, None where none can be written."""
    files = {Path(function.__code__.co_filename) for function in functions}
    for folder in (
        _ROOT,
        *(_ROOT / room for room in ("control", "control/laws", "plant")),
    ):  # constants come from there
        files.update(folder.glob("*.py"))
    digest = hashlib.sha256(sys.version.encode())
    for file in sorted(files):
        digest.update(file.read_bytes())
    try:
        home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        folder = home / PACKAGE / "compiled" / digest.hexdigest()[:16]
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "lock").touch()
        os.utime(folder)
        _prune(folder.parent)
    except (OSError, RuntimeError):  # RuntimeError: no home folder
        return None
    return folder


def _prune(base: Path) -> None:
    """Remove all but the newest generations of compiled code."""
    folders = sorted(base.iterdir(), key=lambda folder: folder.stat().st_mtime, reverse=True)
    for old in folders[KEPT_FOLDERS:]:
        shutil.rmtree(old, ignore_errors=True)


def _locked_cache(function: Callable) -> Any:
    """Return numba's disk cache with a lock round writing.

    numba writes its index and its data file in two steps; two processes that compile different
    signatures at once could otherwise end with an index entry that names the other's code.
    """
    from numba.core.caching import FunctionCache

    class LockedCache(FunctionCache):
        def save_overload(self, sig: Any, data: Any) -> None:
            with open(Path(self.cache_path) / "lock", "w") as lock:
                fcntl.flock(lock, fcntl.LOCK_EX)
                super().save_overload(sig, data)

    return LockedCache(function)
