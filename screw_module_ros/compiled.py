# SPDX-License-Identifier: Apache-2.0
"""Compiled twins of the pure functions of this package.

Laws and physics are plain Python functions of floats, ints, bools and NamedTuples of these; the
memory of a law is a dataclass. `compiled(function)` returns the same function as machine code
(numba, nopython), with the functions of this package that it calls compiled too. Source and plain
function stay unchanged, so the realtime node, the fast simulation and the tests run the same
source.

The machine code is cached on disk. The folder's name is a hash of the source files of all functions
reached and the constants they use, because numba's own cache does not detect a change of a called
function. Processes may share the folder.
"""

from __future__ import annotations

import contextlib
import dis
import fcntl
import functools
import hashlib
import os
import shutil
import sys
import tempfile
import types
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

PACKAGE = __name__.partition(".")[0]
KEPT_FOLDERS = 40  # compiled generations kept on disk, the oldest are removed first

_twins: dict[Callable, Callable] = {}  # results of `compiled`
_inner: dict[Callable, Callable] = {}  # their callees: not called from Python, not cached alone


class CompileError(RuntimeError):
    """A function cannot be compiled; the message says why and what to do."""


def compiled(function: Callable) -> Callable:
    """Return the compiled twin of a pure module-level function of this package.

    Functions it calls must be module-level functions of this package imported by name
    (`from .friction import steady_level`) or functions of `math`. Compilation happens at the first
    call with arguments of a new type (seconds), or is read from the disk cache (a fraction of one).

    Raises CompileError when numba is missing or the function has a closure.
    """
    if function not in _twins:
        reached = _reached(function)
        for callee in reached[:-1]:
            if callee not in _inner:
                _inner[callee] = _njit(callee, no_cpython_wrapper=True, no_cfunc_wrapper=True)
        twin = _njit(function)
        with _cache_folder(_fingerprint(reached)):
            twin._cache = _shared_cache(twin.py_func)
        _twins[function] = twin
    return _twins[function]


def packed(record: Any) -> Any:
    """Return a NamedTuple or a dataclass, nested ones too, as a numpy array with one element.

    A compiled function takes such an array in 0.2 us and a NamedTuple in 0.1 us per number. Its
    element has the record's attributes: `def twin(packed_p, x): return law(packed_p[0], x)`. Where
    the function sets one, the array changes, as the dataclass does in plain Python. Numbers only; a
    tuple or list of numbers becomes an array of floats.
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
    return numpy.dtype(type(value))


def _plain(value: Any) -> Any:
    if names := _names(value):
        return tuple(_plain(getattr(value, name)) for name in names)
    return tuple(value) if isinstance(value, (tuple, list)) else value


def _reached(function: Callable) -> list[Callable]:
    """Return the functions of this package that `function` reaches, callees first, itself last."""
    order: list[Callable] = []
    open_calls: list[Callable] = []

    def visit(current: Callable) -> None:
        if current in order:
            return
        if current in open_calls:
            raise CompileError(f"{_name(current)} calls itself: it cannot be compiled")
        if current.__closure__:
            raise CompileError(f"{_name(current)} is a closure: only module-level functions can")
        open_calls.append(current)
        for value in _used_globals(current).values():
            if isinstance(value, types.FunctionType):
                visit(value)
        open_calls.pop()
        order.append(current)

    visit(function)
    return order


def _used_globals(function: Callable) -> dict[str, Any]:
    """Return the globals a function's code names, by name."""
    space = function.__globals__
    names = {step.argval for step in dis.get_instructions(function) if step.opname == "LOAD_GLOBAL"}
    return {name: space[name] for name in sorted(names) if name in space}


def _name(function: Callable) -> str:
    return f"{function.__module__}.{function.__qualname__}"


def _fingerprint(functions: list[Callable]) -> str:
    """Return a short hash of everything that determines the machine code."""
    digest = hashlib.sha256(f"{sys.version_info[:2]}".encode())
    for path in sorted({function.__code__.co_filename for function in functions}):
        digest.update(Path(path).read_bytes())
    for function in functions:
        for name, value in _used_globals(function).items():
            if isinstance(value, (bool, int, float, str, tuple)):
                digest.update(f"{_name(function)}.{name}={value!r}".encode())
            elif isinstance(value, type) and hasattr(value, "_fields"):
                digest.update(f"{name}:{value._fields!r}".encode())
    return digest.hexdigest()[:16]


def _njit(function: Callable, **options: bool) -> Callable:
    """Return a numba dispatcher for one function whose callees are in `_inner` already."""
    space = dict(function.__globals__)
    for name, value in _used_globals(function).items():
        if isinstance(value, types.FunctionType):
            space[name] = _inner[value]
    copy = types.FunctionType(
        function.__code__, space, function.__name__, function.__defaults__, None
    )
    copy.__module__ = function.__module__
    copy.__qualname__ = function.__qualname__
    copy.__kwdefaults__ = function.__kwdefaults__
    return _numba().njit(error_model="numpy", **options)(copy)


def _numba():
    try:
        import numba
    except ImportError as error:
        raise CompileError(
            f"numba cannot be imported ({error}); it is a pinned dependency of this package: "
            "run `make build`, or pip install the numba named in requirements/runtime.txt"
        ) from error
    return numba


def _shared_cache(function: Callable):
    """Return numba's disk cache with a lock round writing.

    numba writes its index and its data file in two steps; two processes that compile different
    signatures at once could otherwise end with an index entry that names the other's code.
    """
    from numba.core.caching import FunctionCache

    class SharedCache(FunctionCache):
        def save_overload(self, sig, data):
            with _locked(Path(self.cache_path)):
                super().save_overload(sig, data)

    return SharedCache(function)


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[None]:
    with open(folder / "lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


@contextlib.contextmanager
def _cache_folder(fingerprint: str) -> Iterator[None]:
    """Make numba look for its cache in the folder of this fingerprint."""
    numba = _numba()
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(_folder(fingerprint))
    try:
        yield
    finally:
        numba.config.CACHE_DIR = before


def _folder(fingerprint: str) -> Path:
    """Return the folder of a fingerprint; one that ends with the process if home is read-only."""
    try:
        home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        base = home / PACKAGE / "compiled"
        folder = base / fingerprint
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
        os.utime(folder)
    except (OSError, RuntimeError):  # RuntimeError: no home folder
        return Path(_own_folder().name)
    with contextlib.suppress(OSError):  # another process may do the same
        _prune(base)
    return folder


@functools.cache
def _own_folder() -> tempfile.TemporaryDirectory:
    return tempfile.TemporaryDirectory(prefix=f"{PACKAGE}-")


def _prune(base: Path) -> None:
    """Remove all but the newest generations of compiled code."""
    folders = sorted(base.iterdir(), key=lambda folder: folder.stat().st_mtime, reverse=True)
    for old in folders[KEPT_FOLDERS:]:
        shutil.rmtree(old, ignore_errors=True)
