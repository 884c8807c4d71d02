# SPDX-License-Identifier: Apache-2.0
"""Version of a law: what it does in its envelope, to which results are held.

A law of this package is known by its bits: `control/laws/versions.yaml` keeps, for each law, the
digests of long runs of it (`test/control/test_law_bits.py`) beside the digest of its source. While
the source is that one, the version is that of the runs, so rewriting a law without a change of a
bit changes no version. A source that was changed here and not tried has a version of its own: the
digest of the source.
"""

from __future__ import annotations

import functools
import hashlib
from pathlib import Path
from typing import NamedTuple

from ..control import laws
from ..control.envelope import enveloped, initial_state
from ..control.law import Law
from ..control.laws.thesis import THESIS
from ..settings_file import read_file
from .source_version import UNKNOWN, source_version

FILE = Path(laws.__file__).with_name("versions.yaml")


class Known(NamedTuple):
    """What is known of a law of this package.

    runs: mode -> digest of a run of the law, bit for bit, ANY for one through all modes; source:
    its digest when they were found; formerly: versions that software with the same runs has given
    the law.
    """

    runs: dict[str, str]
    source: str
    formerly: tuple[str, ...] = ()

    @property
    def behaviour(self) -> str:
        """Return the version of the runs, twelve hexadecimal digits."""
        text = "\n".join(f"{mode} {run}" for mode, run in sorted(self.runs.items()))
        return hashlib.sha256(text.encode()).hexdigest()[:12]


class _Versions(NamedTuple):
    laws: dict[str, Known]


@functools.cache
def known_laws() -> dict[str, Known]:
    """Return what is known of this package's laws, by name. Raises SettingError."""
    return read_file(FILE, _Versions).laws


@functools.cache
def law_version(law: Law = THESIS) -> str:
    """Return the version of a law, twelve hexadecimal digits; see the module's text.

    Of a law of others it is the digest of its source: see `source_of`.
    """
    source = source_of(law)
    known = known_laws().get(law.name) if law in laws.LAWS else None
    return known.behaviour if known and known.source == source else source


def fits(version: str, law: Law) -> bool:
    """Return whether a version, which a file states, is that of a law or one with the same runs."""
    own = law_version(law)
    known = known_laws().get(law.name) if law in laws.LAWS else None
    same = known.formerly if known and known.behaviour == own else ()
    return own != UNKNOWN and version in (own, *same)


@functools.cache
def source_of(law: Law) -> str:
    """Return the digest of a law's source, twelve hexadecimal digits.

    Of a law of this package it is of what its step reaches. What `behaviour.digest` does not see
    stands in the conditions of gain limits as far as the linear model depends on it: values of
    settings, rate and delay of the loop, the encoder's filter. Of a law of others it is that of the
    envelope together with all of the law's file, without comments and docstrings; what the file
    imports from elsewhere is not seen. It is "unknown" where a source cannot be read.
    """
    functions = (law.foresee, law.ask, law.help, law.rest, law.memory, law.own)
    return source_version(functions, law.settings, (enveloped, initial_state))
