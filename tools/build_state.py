# SPDX-License-Identifier: Apache-2.0
"""Which build lies here: commit, what differs from it, and a digest of what tests depend on.

Results of tests belong to the build of which they were found. The digest is of the files, so that
a commit of a page ends no result, and a changed byte of a law, a parameter or a test does.
"""

from __future__ import annotations

import hashlib
import subprocess
from collections.abc import Iterable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
TRIED = (
    "screw_module_ros", "msg_defs", "params", "urdf", "launch", "security", "requirements", "test",
    "setup.py", "pyproject.toml",
)  # fmt: skip
UNKNOWN = "unknown"
_MADE = ("__pycache__", ".hypothesis", ".pytest_cache")


def digest(places: Iterable[Path]) -> str:
    """Return the SHA-256 of files and of all files below folders, names included."""
    result = hashlib.sha256()
    for place in places:
        for file in sorted(place.rglob("*")) if place.is_dir() else [place]:
            made = file.suffix in (".pyc", ".nbi", ".nbc") or set(_MADE) & set(file.parts)
            if file.is_file() and not made and ".egg-info" not in str(file):
                told = file.relative_to(place.parent).as_posix().encode()
                result.update(told + b"\0" + file.read_bytes() + b"\0")
    return result.hexdigest()


def state(root: Path = ROOT) -> dict[str, Any]:
    """Return commit, its date, the paths that differ from it, and the digest of what is tried.

    Without git the commit is unknown, and so is what differs.
    """
    commit, date = (_git(root, "log", "-1", f"--format={what}").strip() for what in ("%H", "%cI"))
    changed = _git(root, "status", "--porcelain", "--no-renames").splitlines()
    return {
        "commit": commit or UNKNOWN, "committed": date or UNKNOWN,
        "dirty": [line[3:] for line in changed] if commit else [UNKNOWN],
        "tried": digest([root / name for name in TRIED if (root / name).exists()]),
    }  # fmt: skip


def _git(root: Path, *arguments: str) -> str:
    command = ["git", "-C", str(root), *arguments]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return ""
