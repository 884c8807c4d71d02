# SPDX-License-Identifier: Apache-2.0
"""Version of laws and arms: a digest of the sources of their functions."""

from __future__ import annotations

import hashlib
import importlib
import inspect
from collections.abc import Callable
from typing import Any

from ..behaviour import PACKAGE, canonical_source, digest

UNKNOWN = "unknown"
"""Version of what has no source that can be read."""


def source_version(functions: tuple[Callable, ...], settings: Any, around: tuple = ()) -> str:
    """Return twelve hexadecimal digits for what functions do.

    around: functions of this package that call them. Of functions of this package it is the digest
    of what they reach, with those; of others together with all of their file, and that of the
    settings, without comments and docstrings; what the file imports from elsewhere is not seen. It
    is "unknown" where a source cannot be read.
    """
    modules = {_module(each) for each in (*functions, settings)}
    files = sorted(module for module in modules if module.partition(".")[0] != PACKAGE)
    shared = [each for each in functions if _module(each) not in files]
    try:
        found = digest(*around, *shared)
        sources = [inspect.getsource(importlib.import_module(file)) for file in files]
        texts = [canonical_source(source) for source in sources]
    except Exception:  # somebody else's: anything may come out of it
        return UNKNOWN
    if not files:
        return found
    return hashlib.sha256("\n".join([found, *texts]).encode()).hexdigest()[:12]


def _module(part: Any) -> str:
    """Return the module of a function or a class; that of what a partial calls."""
    return getattr(getattr(part, "func", part), "__module__", "") or ""
