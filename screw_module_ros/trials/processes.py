# SPDX-License-Identifier: Apache-2.0
"""Resources of a process from Linux's /proc: memory, file handles, threads, shared memory files."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

_SHARED = "/dev/shm/"


class Usage(NamedTuple):
    """Resources that one process uses now.

    memory: pages of its own in memory (RssAnon) [MiB]; handles: open files; threads;
    shared: distinct files of /dev/shm that it has mapped.
    """

    memory: float
    handles: int
    threads: int
    shared: int


def usage(pid: int) -> Usage:
    """Return the resources of a process. Raises OSError if it has ended."""
    folder = Path(f"/proc/{pid}")
    status = dict(
        line.split(":", 1) for line in (folder / "status").read_text().splitlines() if ":" in line
    )
    if "VmRSS" not in status:
        raise ProcessLookupError(f"process {pid} has ended")
    shared = {
        line[line.index(_SHARED) :]
        for line in (folder / "maps").read_text().splitlines()
        if _SHARED in line
    }
    return Usage(
        _mebibytes(status["RssAnon"]),
        sum(1 for _ in (folder / "fd").iterdir()),
        int(status["Threads"]),
        len(shared),
    )


def _mebibytes(text: str) -> float:
    return int(text.split()[0]) / 1024.0
