# SPDX-License-Identifier: Apache-2.0
"""Finds what a run leaves behind: processes, and Fast DDS's files in shared memory.

Processes are known by a variable that children inherit, so also those that were orphaned. Others
on the machine may be making such files at the same time, so a file belongs to the run when one of
its processes owned it, or when it is named after a port of the run's ROS domain and was not there
before: an earlier run in that domain may have been killed. Fast DDS's ports from 7000 on are shared
by all domains and used again by whoever comes next: nobody's.

The owner of a segment or port holds its lock file open; others only map it.
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
LOCK_SUFFIX = "_el"
SECONDS_BETWEEN_LOOKS = 0.5
_PORT = re.compile(r"fastrtps_port(\d+)$")


class Owned(NamedTuple):
    """A file of Fast DDS in shared memory: names are used again, so the inode tells."""

    name: str
    inode: int


class Watch:
    """Notes, from entering to leaving, which shared memory files the marked processes own.

    owned: each with the command of its owner.
    """

    def __init__(self, mark: str, ports: range) -> None:
        self._entry = f"{MARK}={mark}".encode()
        self._ports = ports
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._look_on, daemon=True)
        self.owned: dict[Owned, str] = {}
        self._before = self._ports_there()

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
        """Return the run's files that a process left in shared memory, and that nobody owns now.

        A port whose lock file is gone was closed by its owner, and is none of them: it only
        stayed because a process that wrote to it was killed, as tests do.
        """
        owned = {name for name, inode in self.owned if _inode(SHARED_MEMORY / name) == inode}
        ports = {name for name, _ in self._ports_there() - self._before}
        ours = {name for name in owned if not _PORT.match(name)} | ports
        ours = {name for name in ours if (SHARED_MEMORY / (name + LOCK_SUFFIX)).exists()}
        owned_now = {file.name for pid in _process_ids() for file in owned_files(pid)}
        return sorted(file for name in ours - owned_now for file in family(name))

    def owner(self, file: Path) -> str:
        """Return the command of the process that owned a file last, empty if none was seen."""
        name = file.name.removeprefix("sem.").removesuffix("_mutex").removesuffix(LOCK_SUFFIX)
        return next((command for owned, command in self.owned.items() if owned.name == name), "")

    def remove_closed_ports(self) -> None:
        """Remove the ports of the run that their owners closed; to be called after it."""
        for name, _ in self._ports_there() - self._before:
            for file in family(name):
                file.unlink(missing_ok=True)

    def _ports_there(self) -> set[Owned]:
        found = (_PORT.match(file.name) for file in SHARED_MEMORY.glob("fastrtps_port*"))
        ours = [port[0] for port in found if port and int(port[1]) in self._ports]
        return {Owned(name, _inode(SHARED_MEMORY / name)) for name in ours}

    def _look_on(self) -> None:
        while not self._stop.wait(SECONDS_BETWEEN_LOOKS):
            for pid, command in self.processes().items():
                self.owned.update(dict.fromkeys(owned_files(pid), command))


def owned_files(pid: int) -> set[Owned]:
    """Return the Fast DDS segments and ports that a process owns."""
    found = set()
    for link in Path(f"/proc/{pid}/fd").glob("*"):
        try:
            file = link.readlink()
        except OSError:  # closed meanwhile, or the process is another user's
            continue
        name = file.name.removesuffix(LOCK_SUFFIX)
        if file.parent == SHARED_MEMORY and name != file.name:
            found.add(Owned(name, _inode(SHARED_MEMORY / name)))
    return found


def family(name: str) -> list[Path]:
    """Return what exists of a Fast DDS file, its lock file and its semaphore."""
    names = (name, name + LOCK_SUFFIX, f"sem.{name}_mutex")
    return [SHARED_MEMORY / n for n in names if (SHARED_MEMORY / n).exists()]


def kill(pid: int) -> None:
    """Kill a process and remove the shared memory that it owned."""
    owned = owned_files(pid)
    os.kill(pid, signal.SIGKILL)
    for name, _ in owned:
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
