# SPDX-License-Identifier: Apache-2.0
"""Version of a law: a digest of what it does in its envelope, to which results are held."""

from __future__ import annotations

import functools
import hashlib
import importlib
import inspect
from typing import Any

from ..behaviour import PACKAGE, canonical_source, digest
from ..control.envelope import enveloped, initial_state
from ..control.law import Law
from ..control.laws.thesis import THESIS


@functools.cache
def law_version(law: Law = THESIS) -> str:
    """Return the version of a law, twelve hexadecimal digits.

    Of a law of this package it is the digest of what its step reaches. What `behaviour.digest` does
    not see stands in the conditions of gain limits as far as the linear model depends on it: values
    of settings, rate and delay of the loop, the encoder's filter. Of a law of others it is that of
    the envelope together with all of the law's file, without comments and docstrings; what the file
    imports from elsewhere is not seen. It is "unknown" where a source cannot be read.
    """
    functions = (law.foresee, law.ask, law.help, law.rest, law.memory, law.own)
    modules = {_module(each) for each in (*functions, law.settings)}
    files = sorted(module for module in modules if module.partition(".")[0] != PACKAGE)
    shared = [each for each in functions if _module(each) not in files]
    try:
        found = digest(enveloped, initial_state, *shared)
        sources = [inspect.getsource(importlib.import_module(file)) for file in files]
        texts = [canonical_source(source) for source in sources]
    except (OSError, TypeError, SyntaxError):
        return "unknown"
    if not files:
        return found
    return hashlib.sha256("\n".join([found, *texts]).encode()).hexdigest()[:12]


def _module(part: Any) -> str:
    """Return the module of a function or a class; that of what a partial calls."""
    return getattr(getattr(part, "func", part), "__module__", "") or ""
