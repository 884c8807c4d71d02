# SPDX-License-Identifier: Apache-2.0
"""The page of memory that the processes of one simulated robot share.

It is a file of 64-bit words in shared memory, found by ROS domain and namespace. A file lock
protects the allocation of rows; other access is to single words. The last user removes the file.
"""

from __future__ import annotations

import ctypes
import fcntl
import functools
import mmap
import os
import platform
import threading
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

FOREVER = 2**62
"""Time of a thread that waits for nothing: idle, or ended [ns]."""
BUSY = 0
NOBODY = -1
START_NS = 1_000_000_000_000
"""Start of simulated time [ns]: far from 0, which means never."""

USERS, SLOTS, LINES, TOPICS, HOPS = 64, 96, 64, 192, 320
_NAME_BYTES = 96
_VERSION = 5
_FOLDER = Path("/dev/shm")
_FUTEX = {"x86_64": 202, "aarch64": 98}.get(platform.machine())
_FUTEX_WAIT, _FUTEX_WAKE = 0, 1
_WORD = 8

_HEADER = ("version", "now", "conductor", "roster", "wake", "asleep", "factor", "top")
_TABLES = (
    ("user_pid", USERS),
    ("slot_pid", SLOTS), ("slot_until", SLOTS), ("slot_wake", SLOTS), ("slot_asleep", SLOTS),
    ("slot_declared", SLOTS),
    ("line_pid", LINES), ("line_bus", LINES), ("line_sent", LINES), ("line_handled", LINES),
    ("line_base", LINES), ("line_waiter", LINES),
    ("topic_key", TOPICS), ("topic_pid", TOPICS), ("topic_published", TOPICS),
    ("topic_base", TOPICS), ("topic_settled", TOPICS),
    ("hop_pid", HOPS), ("hop_topic", HOPS), ("hop_taken", HOPS), ("hop_follows", HOPS),
    ("hop_waiter", HOPS),
)  # fmt: skip
_WORDS = len(_HEADER) + sum(count for _, count in _TABLES)
_SIZE = _WORDS * _WORD + SLOTS * _NAME_BYTES

_syscall = ctypes.CDLL(None).syscall
_syscall.argtypes = (
    ctypes.c_long, ctypes.c_void_p, ctypes.c_int, ctypes.c_uint, ctypes.c_void_p
)  # fmt: skip


class _Timespec(ctypes.Structure):
    _fields_ = (("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long))


@functools.lru_cache(maxsize=64)
def _limit(timeout_s: float) -> Any:
    """Return the kernel's form of a duration [s]; nearly all sleeps are of the same few."""
    return ctypes.byref(_Timespec(int(timeout_s), int(timeout_s % 1.0 * 1e9)))


class TableFull(RuntimeError):
    """More threads, buses or topics than the page has rows for."""


class Page:
    """The words of one page; attributes named as in the tables are arrays of 64-bit integers.

    now: simulated time [ns]. conductor: process id of the rig, 0 = none. roster: changes with each
    row that is taken or returned. factor: real-time factor in per mille.
    user_*: one row per process that has the page open. slot_*: one row per thread: the time that it
    waits for [ns], its wake word, number of its declarations. line_*: one row per open bus: frames
    sent and handled. topic_*: messages published in all, and before the present time.
    hop_*: one row per subscription: newest message taken, whether it keeps up, which thread waits.
    """

    def __init__(self, name: str):
        """Open the page called `name`, or create it. Raises OSError."""
        self.path = _FOLDER / f"screw_module_ros_{os.getuid()}_{name}"
        self._lock = threading.Lock()  # a file lock does not exclude threads of the same process
        self._file = _opened_and_locked(self.path)
        try:
            self._map()
            for pid in {*self.user_pid} - {0}:
                if not alive(pid):
                    self.dismiss(pid)
            self._user = self.take(self.user_pid, os.getpid(), "process")
        finally:
            fcntl.flock(self._file, fcntl.LOCK_UN)

    def _map(self) -> None:
        memory = mmap.mmap(self._file, _SIZE)
        self._memory = memory
        words = memoryview(memory)[: _WORDS * _WORD].cast("q")
        self.header = words[: len(_HEADER)]
        self._address = ctypes.addressof(ctypes.c_char.from_buffer(memory))
        at = len(_HEADER)
        self._at: dict[str, int] = {}
        for table, count in _TABLES:
            setattr(self, table, words[at : at + count])
            self._at[table] = at
            at += count
        self._names = memoryview(memory)[_WORDS * _WORD :]
        self._prepare()

    def _prepare(self) -> None:
        if self.header[0] == _VERSION:
            return
        self._memory[:] = bytes(_SIZE)  # a page of another version of this package
        for index in range(SLOTS):
            self.slot_until[index] = FOREVER
        for table in (self.line_waiter, self.hop_waiter):
            for index in range(len(table)):
                table[index] = NOBODY
        self.header[1] = START_NS
        self.header[0] = _VERSION

    @contextmanager
    def locked(self):
        """Lock the page: one thread of one process at a time takes and returns rows."""
        with self._lock:
            fcntl.flock(self._file, fcntl.LOCK_EX)
            try:
                yield
            finally:
                fcntl.flock(self._file, fcntl.LOCK_UN)

    # Header --------------------------------------------------------------------------------

    @property
    def now_ns(self) -> int:
        """Simulated time [ns]."""
        return self.header[1]

    @now_ns.setter
    def now_ns(self, now_ns: int) -> None:
        self.header[1] = now_ns

    @property
    def conductor(self) -> int:
        """Process id of the conductor, 0 = none."""
        return self.header[2]

    @conductor.setter
    def conductor(self, pid: int) -> None:
        self.header[2] = pid

    @property
    def roster(self) -> int:
        """Changes whenever a row is taken or returned."""
        return self.header[3]

    @property
    def top(self) -> int:
        """Upper bound of the slots in use."""
        return self.header[7] or SLOTS

    @top.setter
    def top(self, top: int) -> None:
        self.header[7] = top

    @property
    def factor(self) -> float:
        """Simulated seconds per second of wall clock, over the last second or so."""
        return self.header[6] * 1e-3

    @factor.setter
    def factor(self, factor: float) -> None:
        self.header[6] = round(factor * 1e3)

    # Rows ----------------------------------------------------------------------------------

    def take(self, table: memoryview, value: int, what: str) -> int:
        """Take the first free row (0) of `table`, with the lock held. Raises TableFull."""
        for index in range(len(table)):
            if not table[index]:
                table[index] = value
                self.header[7] = 0
                self.changed()
                return index
        raise TableFull(f"no room for one more {what} in simulated time: {len(table)} are there")

    def changed(self) -> None:
        """Notify the conductor that the roster has changed."""
        self.header[3] += 1

    def name(self, slot: int) -> str:
        """Return the name of the thread in a slot."""
        raw = bytes(self._names[slot * _NAME_BYTES : (slot + 1) * _NAME_BYTES])
        return raw.rstrip(b"\0").decode(errors="replace")

    def set_name(self, slot: int, name: str) -> None:
        """Name the thread in a slot."""
        raw = name.encode()[:_NAME_BYTES].ljust(_NAME_BYTES, b"\0")
        self._names[slot * _NAME_BYTES : (slot + 1) * _NAME_BYTES] = raw

    def dismiss(self, pid: int) -> None:
        """Return all rows of a process; the caller holds the lock."""
        for index in range(USERS):
            if self.user_pid[index] == pid:
                self.user_pid[index] = 0
        for index in range(SLOTS):
            if self.slot_pid[index] == pid:
                self.slot_until[index] = FOREVER
                self.slot_asleep[index] = 0
                self.slot_pid[index] = 0
        for index in range(LINES):
            if self.line_pid[index] == pid:
                self.line_waiter[index] = NOBODY
                self.line_pid[index] = 0
        for index in range(TOPICS):
            if self.topic_pid[index] == pid:
                self.topic_pid[index] = 0
        for index in range(HOPS):
            if self.hop_pid[index] == pid:
                self.hop_follows[index] = 0
                self.hop_waiter[index] = NOBODY
                self.hop_pid[index] = 0
        if self.conductor == pid:
            self.conductor = 0
        self.changed()

    def close(self) -> None:
        """Close the page; the last user removes it."""
        with self.locked():
            self.user_pid[self._user] = 0
            if os.getpid() not in self.user_pid:
                self.dismiss(os.getpid())
            if not any(alive(pid) for pid in {*self.user_pid} - {0}):
                with suppress(FileNotFoundError):
                    self.path.unlink()
        os.close(self._file)

    # Waking --------------------------------------------------------------------------------

    def wake_slot(self, slot: int) -> None:
        """Wake the thread in a slot, if it sleeps."""
        self.slot_wake[slot] += 1
        if self.slot_asleep[slot]:
            self._wake(self._at["slot_wake"] + slot)

    def sleep_slot(self, slot: int, seen: int, timeout_s: float) -> None:
        """Sleep until `slot_wake` of the slot is no longer `seen`, or for `timeout_s`."""
        self.slot_asleep[slot] = 1
        self._sleep(self._at["slot_wake"] + slot, seen, timeout_s)
        self.slot_asleep[slot] = 0

    def wake_conductor(self) -> None:
        """Wake the conductor, if it sleeps."""
        self.header[4] += 1
        if self.header[5]:
            self._wake(4)

    def sleep_conductor(self, seen: int, timeout_s: float) -> None:
        """Sleep until a member wakes the conductor, or for `timeout_s`; seen: `header[4]`."""
        self.header[5] = 1
        self._sleep(4, seen, timeout_s)
        self.header[5] = 0

    def _wake(self, word: int) -> None:
        _syscall(_FUTEX, self._address + word * _WORD, _FUTEX_WAKE, 1, None)

    def _sleep(self, word: int, seen: int, timeout_s: float) -> None:
        # A futex is the low half of the word.
        _syscall(
            _FUTEX, self._address + word * _WORD, _FUTEX_WAIT, seen & 0xFFFFFFFF, _limit(timeout_s)
        )


def sweep(domain: str) -> None:
    """Remove the pages of a ROS domain whose users were all killed."""
    for path in _FOLDER.glob(f"screw_module_ros_{os.getuid()}_{int(domain or 0)}*"):
        name = path.name.split("_", 4)[-1]
        if name != str(int(domain or 0)) and not name.startswith(f"{int(domain or 0)}_"):
            continue
        with suppress(OSError):
            Page(name).close()


def page_name(domain: str, namespace: str) -> str:
    """Return the page's name for a ROS domain and a namespace."""
    number, below = str(int(domain or 0)), namespace.strip("/").replace("/", ".")
    return f"{number}_{below}" if below else number


def alive(pid: int) -> bool:
    """Return whether the process is there and no zombie."""
    try:
        state = _state(Path(f"/proc/{pid}"))
    except (OSError, IndexError):
        return False
    return state not in "ZX"


def works(pid: int) -> bool:
    """Return whether a thread of the process runs or waits for a core or a disk."""
    for task in Path(f"/proc/{pid}/task").glob("*"):
        with suppress(OSError, IndexError):
            if _state(task) in "RD":
                return True
    return False


def _state(folder: Path) -> str:
    """Return the kernel's letter for the state of a process or thread, from its folder in /proc."""
    return (folder / "stat").read_text().rpartition(")")[2].split()[0]


def _opened_and_locked(path: Path) -> int:
    """Open or create the file and lock it; retry if its last user is just removing it."""
    while True:
        file = os.open(path, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
        fcntl.flock(file, fcntl.LOCK_EX)
        with suppress(FileNotFoundError):
            if os.fstat(file).st_ino == os.stat(path).st_ino:
                if os.fstat(file).st_size < _SIZE:
                    os.ftruncate(file, _SIZE)
                return file
        os.close(file)
