# SPDX-License-Identifier: Apache-2.0
"""Version of a law: a digest of what it does in its envelope, to which results are held."""

from __future__ import annotations

import functools
import hashlib
import importlib
import inspect

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
    imports from elsewhere is not seen. Raises OSError when a source cannot be read.
    """
    functions = (law.foresee, law.ask, law.help, law.rest, law.memory, law.own)
    own = [function for function in functions if _outside(function.__module__)]
    shared = [function for function in functions if function not in own]
    found = digest(enveloped, initial_state, *shared)
    files = sorted({function.__module__ for function in own})
    if not files:
        return found
    texts = [canonical_source(inspect.getsource(importlib.import_module(file))) for file in files]
    return hashlib.sha256("\n".join([found, *texts]).encode()).hexdigest()[:12]


def _outside(module: str) -> bool:
    return module.partition(".")[0] != PACKAGE
