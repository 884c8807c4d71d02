# SPDX-License-Identifier: Apache-2.0
"""Which software runs: the package's version, and a digest of its source."""

from __future__ import annotations

import functools
import hashlib
from importlib import metadata
from pathlib import Path

UNKNOWN = "unknown"


def version() -> str:
    """Return the version of this package, "unknown" where it is not installed."""
    try:
        return metadata.version("screw_module_ros")
    except metadata.PackageNotFoundError:
        return UNKNOWN


@functools.cache
def software() -> str:
    """Return version and digest, twelve hexadecimal digits, of the package's Python files.

    A changed byte of any of them, in a release or beside one, gives another digest; "unknown" where
    a file cannot be read.
    """
    root, digest = Path(__file__).parent, hashlib.sha256()
    try:
        for path in sorted(root.rglob("*.py")):
            digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    except OSError:
        return f"{version()} {UNKNOWN}"
    return f"{version()} {digest.hexdigest()[:12]}"
