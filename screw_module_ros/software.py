# SPDX-License-Identifier: Apache-2.0
"""Which software runs: the package's version, a digest of its source, and the commit."""

from __future__ import annotations

import functools
import hashlib
import subprocess
from importlib import metadata
from pathlib import Path

UNKNOWN, DIRTY = "unknown", ", dirty"
_RUNS = ("screw_module_ros", "msg_defs", "params", "urdf", "launch", "security", "requirements")
"""Folders of a checkout that decide how the robot moves; a page of `docs` does not."""


def version() -> str:
    """Return the version of this package, "unknown" where it is not installed."""
    try:
        return metadata.version("screw_module_ros")
    except metadata.PackageNotFoundError:
        return UNKNOWN


@functools.cache
def commit() -> str:
    """Return the commit, twelve hexadecimal digits, of the checkout that the package runs from.

    ", dirty" stands behind it where code, messages, model or parameters there differ from it. It is
    "unknown" without a checkout, as where a copy of the package was installed, and without git.
    """
    root = Path(__file__).resolve().parent.parent
    command = [
        "git", "--no-optional-locks", f"--git-dir={root / '.git'}", f"--work-tree={root}",
        "status", "--porcelain=v2", "--branch", "--", *_RUNS,
    ]  # fmt: skip
    try:
        told = subprocess.run(command, capture_output=True, text=True, check=True, cwd=root).stdout
    except (OSError, subprocess.CalledProcessError):
        return UNKNOWN
    branch, *others = told.splitlines()
    differs = any(not line.startswith("#") for line in others)
    return branch.removeprefix("# branch.oid ")[:12] + (DIRTY if differs else "")


@functools.cache
def software() -> str:
    """Return version and digest, twelve hexadecimal digits, of the package's Python files.

    A changed byte of any of them, in a release or beside one, gives another digest; "unknown" where
    a file cannot be read. The commit stands behind both.
    """
    root, digest = Path(__file__).parent, hashlib.sha256()
    try:
        for path in sorted(root.rglob("*.py")):
            digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    except OSError:
        return f"{version()} {UNKNOWN}, commit {commit()}"
    return f"{version()} {digest.hexdigest()[:12]}, commit {commit()}"
