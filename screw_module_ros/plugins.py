# SPDX-License-Identifier: Apache-2.0
"""What other packages bring: objects found by entry point, files that lie beside their modules."""

from __future__ import annotations

import importlib
import importlib.util
import signal
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from .settings import SettingError

_LONGEST = 300  # characters


def one_line(text: str) -> str:
    """Return somebody's text as any message can carry it: one line, printable, short."""
    short = text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."
    return "".join(c if c.isprintable() else "?" for c in " ".join(short.split()))


def told(error: BaseException) -> str:
    """Return what an error of somebody else's code says, in one line: its kind and its text.

    Raises KeyboardInterrupt again: it is the Ctrl-C of who runs this in a terminal. To a node it
    does not come by a signal.
    """
    if isinstance(error, KeyboardInterrupt):
        raise error
    kind = type(error).__name__
    try:
        text = str(error)
    except BaseException:
        text = "its text cannot be told"
    return one_line(f"{kind}: {text}" if text else kind)


def where(error: BaseException) -> str:
    """Return the line of somebody else's file that an error came from, empty if it did not.

    Of what their file calls, like numpy, it is the line that calls.
    """
    ours = (Path(__file__).parent, Path(importlib.__file__).parent)
    places = [
        (Path(frame.f_code.co_filename), line)
        for frame, line in traceback.walk_tb(error.__traceback__)
    ]
    theirs = [
        (file, line) for file, line in places
        if file.exists() and not any(file.is_relative_to(folder) for folder in ours)
    ]  # fmt: skip
    if not theirs:
        return ""
    first = theirs[0][0]
    last = [line for file, line in theirs if file == first][-1]
    return f" ({first.name}, line {last})"


@contextmanager
def _signals_kept() -> Iterator[None]:
    """Put back what ends a process in order, if an import takes it for itself."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            if handler is not None and signal.getsignal(number) is not handler:
                signal.signal(number, handler)


def load(path: str, group: str, what: str) -> Any:
    """Return the object `package.module:NAME`, or that of the group's entry point of this name.

    what: its kind for messages, like `law`. Raises SettingError when there is none.
    """
    points = entry_points(group=group)
    named = sorted({point.value for point in points if point.name == path})
    if len(named) > 1:
        raise SettingError(
            f"{what} {path}: several packages call one so ({', '.join(named)}): name the module"
        )
    module, colon, name = (named[0] if named else path).partition(":")
    if not colon:
        known = ", ".join(sorted(point.name for point in points)) or "none"
        raise SettingError(
            f"{what} {path}: neither package.module:NAME nor an entry point of {group}; "
            f"there: {known}"
        )
    try:
        with _signals_kept():
            return getattr(importlib.import_module(module), name)
    except BaseException as error:  # somebody else's: anything may come out of it
        raise SettingError(f"{what} {path}: {told(error)}") from None


def beside(module: str, name: str) -> Path:
    """Return the path of a file in the folder of a module or package, which is not run.

    Raises SettingError for a module that is not there.
    """
    try:
        spec = importlib.util.find_spec(module)
    except BaseException as error:  # of a package above it, which is run
        raise SettingError(f"{module}:{name}: {told(error)}") from None
    if spec is None or not spec.has_location or spec.origin is None:
        raise SettingError(f"{module}:{name}: there is no package {module}; is it installed?")
    return Path(spec.origin).parent / name
