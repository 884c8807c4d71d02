# SPDX-License-Identifier: Apache-2.0
"""Finds what a run leaves behind: processes, and Fast DDS's files in shared memory.

Processes are known by a variable that children inherit, so also those that were orphaned. A file
belongs to the run when one of its processes had it mapped, or when its name holds one of the run's
DDS ports; others on the machine may be making such files at the same time.
"""

from __future__ import annotations

import os
import re
import signal
import threading
from pathlib import Path

SHARED_MEMORY = Path("/dev/shm")
MARK = "SCREW_MODULE_RUN"
SECONDS_BETWEEN_LOOKS = 0.2
_PORT = re.compile(r"fastrtps_port(\d+)")


class Watch:
    """Notes, from entering to leaving, which shared memory files the marked processes map."""

    def __init__(self, mark: str, ports: range) -> None:
        self._entry = f"{MARK}={mark}".encode()
        self._ports = ports
        self._mapped: set[str] = set()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._look_on, daemon=True)

    def __enter__(self) -> Watch:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def processes(self) -> dict[int, str]:
        """Return the marked processes that are alive, this one excepted, with their commands."""
        found = {}
        for folder in Path("/proc").glob("[0-9]*"):
            pid = int(folder.name)
            if pid != os.getpid() and self._entry in _read(folder / "environ").split(b"\0"):
                command = _read(folder / "cmdline").replace(b"\0", b" ").decode(errors="replace")
                found[pid] = command.strip()
        return found

    def files(self) -> list[Path]:
        """Return the run's files that are still in shared memory."""
        return sorted(f for f in SHARED_MEMORY.glob("*fastrtps_*") if self._is_ours(f.name))

    def _is_ours(self, name: str) -> bool:
        port = _PORT.search(name)
        return int(port[1]) in self._ports if port else name in self._mapped

    def _look_on(self) -> None:
        while not self._stop.wait(SECONDS_BETWEEN_LOOKS):
            for pid in self.processes():
                self._mapped |= mapped_files(pid)


def mapped_files(pid: int) -> set[str]:
    """Return the names of the Fast DDS files that a process has mapped."""
    maps = _read(Path(f"/proc/{pid}/maps")).decode(errors="replace")
    return set(re.findall(r"/dev/shm/(\S*fastrtps_\S*)", maps))


def kill(pid: int) -> None:
    """Kill a process and remove the shared memory that only it used."""
    files = mapped_files(pid)
    os.kill(pid, signal.SIGKILL)
    for name in files:
        if not _PORT.search(name):
            (SHARED_MEMORY / name).unlink(missing_ok=True)


def _read(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError:  # gone meanwhile, or another user's
        return b""
