# SPDX-License-Identifier: Apache-2.0
"""Finds what a run leaves behind: processes, and Fast DDS's files in shared memory.

Processes are known by a variable that children inherit, so also those that were orphaned. A file
belongs to the run when one of its processes had it mapped, or when its name holds a port of the
run's ROS domain; others on the machine may be making such files at the same time.
"""

from __future__ import annotations

import os
import re
import signal
import threading
from pathlib import Path
from typing import NamedTuple

SHARED_MEMORY = Path("/dev/shm")
MARK = "SCREW_MODULE_RUN"
SECONDS_BETWEEN_LOOKS = 0.2
_MAPPED = re.compile(r" (\d+) +/dev/shm/(fastrtps_\w+)$", re.MULTILINE)
_PORT = re.compile(r"fastrtps_port(\d+)$")


class Mapped(NamedTuple):
    """A file of Fast DDS in shared memory: names are used again, so the inode tells."""

    name: str
    inode: int


class Watch:
    """Notes, from entering to leaving, which shared memory files the marked processes map."""

    def __init__(self, mark: str, ports: range) -> None:
        self._entry = f"{MARK}={mark}".encode()
        self._ports = ports
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._look_on, daemon=True)
        self.mapped: set[Mapped] = set()

    def __enter__(self) -> Watch:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def processes(self) -> dict[int, str]:
        """Return the marked processes that are alive, this one excepted, with their commands."""
        found = {}
        for pid in _process_ids():
            if pid != os.getpid() and self._entry in _read(pid, "environ").split(b"\0"):
                command = _read(pid, "cmdline").replace(b"\0", b" ")
                found[pid] = command.decode(errors="replace").strip()
        return found

    def files(self) -> list[Path]:
        """Return the run's files that are still in shared memory and in nobody's use.

        A process that looks for a free port maps the ports of others for a moment, so what is in
        use by now is theirs.
        """
        ours = {f.name for f in SHARED_MEMORY.glob("fastrtps_port*") if self._has_our_port(f)}
        ours |= {name for name, inode in self.mapped if _inode(SHARED_MEMORY / name) == inode}
        in_use = {file.name for pid in _process_ids() for file in mapped_files(pid)}
        return sorted(file for name in ours - in_use for file in family(name))

    def _has_our_port(self, file: Path) -> bool:
        port = _PORT.match(file.name)
        return port is not None and int(port[1]) in self._ports

    def _look_on(self) -> None:
        while not self._stop.wait(SECONDS_BETWEEN_LOOKS):
            self.mapped.update(*map(mapped_files, self.processes()))


def mapped_files(pid: int) -> set[Mapped]:
    """Return the Fast DDS files that a process has mapped."""
    maps = _read(pid, "maps").decode(errors="replace")
    return {Mapped(name, int(inode)) for inode, name in _MAPPED.findall(maps)}


def family(name: str) -> list[Path]:
    """Return what exists of a Fast DDS file, its lock file and its semaphore."""
    names = (name, f"{name}_el", f"sem.{name}_mutex")
    return [SHARED_MEMORY / n for n in names if (SHARED_MEMORY / n).exists()]


def kill(pid: int) -> None:
    """Kill a process and remove the shared memory that only it used."""
    others = (other for other in _process_ids() if other != pid)
    mine = mapped_files(pid).difference(*map(mapped_files, others))
    os.kill(pid, signal.SIGKILL)
    for name, _ in mine:
        for file in family(name):
            file.unlink(missing_ok=True)


def _process_ids() -> list[int]:
    return [int(folder.name) for folder in Path("/proc").glob("[0-9]*")]


def _inode(file: Path) -> int:
    try:
        return file.stat().st_ino
    except OSError:
        return -1


def _read(pid: int, name: str) -> bytes:
    try:
        return Path(f"/proc/{pid}/{name}").read_bytes()
    except OSError:  # gone meanwhile, or another user's
        return b""
