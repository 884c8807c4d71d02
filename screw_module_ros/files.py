# SPDX-License-Identifier: Apache-2.0
"""Files that are complete or not there, for their owner alone where they are a patient's."""

from __future__ import annotations

import os
from pathlib import Path

PRIVATE_FOLDER, PRIVATE_FILE = 0o700, 0o600
STATE_VARIABLE = "XDG_STATE_HOME"


def owner_only(path: str, flags: int) -> int:
    """Open a file, an opener for `open`; a new one is the owner's alone, whatever the umask."""
    return os.open(path, flags, PRIVATE_FILE)


def replace(path: Path, text: str, private: bool = False) -> None:
    """Write a file's text: at any moment, after a power failure too, it is the old or the new one.

    private: for its owner alone. Raises OSError.
    """
    beside = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    beside.unlink(missing_ok=True)
    opener = owner_only if private else None
    try:
        with open(beside, "x", encoding="utf-8", newline="", opener=opener) as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)  # otherwise a power failure may restore the old file
    finally:
        os.close(folder)


def state_folder() -> Path:
    """Return our folder of $XDG_STATE_HOME, else of ~/.local/state: each user has their own."""
    above = os.environ.get(STATE_VARIABLE) or Path.home() / ".local" / "state"
    return Path(above) / "screw_module_ros"
