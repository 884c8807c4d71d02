# SPDX-License-Identifier: Apache-2.0
"""Shared memory of Fast DDS that a killed process left behind.

A node that ends by itself removes its segments. One that was killed cannot, and the files stay in
/dev/shm until somebody removes them.
"""

from __future__ import annotations

from pathlib import Path

_FOLDER = Path("/dev/shm")
_PATTERNS = ("fastrtps_*", "fastdds_*", "sem.fastrtps_*", "sem.fastdds_*")


def segments() -> set[Path]:
    """Return the files Fast DDS keeps in shared memory now, of all processes."""
    return {path for pattern in _PATTERNS for path in _FOLDER.glob(pattern)}


def orphans() -> set[Path]:
    """Return the segments no living process of this user has open or mapped."""
    found = segments()
    if not found:
        return found
    held = set()
    for process in Path("/proc").glob("[0-9]*"):
        held |= _held_by(process)
    return {path for path in found if str(path) not in held}


def remove_orphans() -> int:
    """Remove the orphans; return how many there were."""
    removed = 0
    for path in orphans():
        try:
            path.unlink()
            removed += 1
        except OSError:
            continue
    return removed


def _held_by(process: Path) -> set[str]:
    held = set()
    try:
        for line in (process / "maps").read_text().splitlines():
            if "/dev/shm/" in line:
                held.add(line[line.index("/dev/shm/") :].removesuffix(" (deleted)"))
        for link in (process / "fd").iterdir():
            held.add(str(link.readlink()))
    except OSError:
        pass
    return held
