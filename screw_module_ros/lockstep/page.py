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
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

FOREVER = 2**62
"""Time of a thread that waits for nothing: idle, or ended [ns]."""
BUSY = 0
NOBODY = -1
START_NS = 1_000_000_000_000
"""Start of simulated time [ns]: far from 0, which means never."""

USERS, THREADS, ENDS = 64, 96, 640
_NAME_BYTES = 96
_VERSION = 6
_FOLDER = Path("/dev/shm")
_FUTEX = {"x86_64": 202, "aarch64": 98}.get(platform.machine())
_FUTEX_WAIT, _FUTEX_WAKE = 0, 1
_WORD = 8

_HEADER = ("version", "now", "conductor", "roster", "wake", "asleep", "factor", "top")
NOW, TOP, ROSTER = (_HEADER.index(word) for word in ("now", "top", "roster"))
"""Words of the header that each wait reads, and each message."""
_TABLES = {
    "user_pid": USERS,
    "thread_pid": THREADS, "until": THREADS, "waits": THREADS, "wake": THREADS, "asleep": THREADS,
    "end_pid": ENDS, "channel": ENDS, "sends": ENDS, "sent": ENDS, "settled": ENDS, "taken": ENDS,
    "follows": ENDS, "waiter": ENDS,
}  # fmt: skip
_WORDS = len(_HEADER) + sum(_TABLES.values())
_SIZE = _WORDS * _WORD + THREADS * _NAME_BYTES

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


class NoMemory(OSError):
    """There is no shared memory for the page; the message says why and the way out."""


class TableFull(RuntimeError):
    """More threads or ends of channels than the page has rows for."""


class Page:
    """The words of one page; attributes named as in the tables are arrays of 64-bit integers.

    header[NOW]: simulated time [ns]. conductor: process id of the rig, 0 = none. roster: changes
    with each row that is taken or returned. factor: real-time factor in per mille.
    user_pid: one row per process that has the page open. thread_pid, until, waits, wake, asleep:
    one row per thread: the time that it waits for [ns], the number of its waits, its wake word.
    end_pid, channel, ...: one row per end of a bus, topic or service (see `End`).
    """

    user_pid: memoryview[int]
    thread_pid: memoryview[int]
    until: memoryview[int]
    waits: memoryview[int]
    wake: memoryview[int]
    asleep: memoryview[int]
    end_pid: memoryview[int]
    channel: memoryview[int]
    sends: memoryview[int]
    sent: memoryview[int]
    settled: memoryview[int]
    taken: memoryview[int]
    follows: memoryview[int]
    waiter: memoryview[int]

    def __init__(self, name: str):
        """Open the page called `name`, or create it. Raises OSError, NoMemory."""
        self.path = _FOLDER / f"screw_module_ros_{os.getuid()}_{name}"
        self._lock = threading.Lock()  # a file lock does not exclude threads of the same process
        self._file = _opened_and_locked(self.path)
        try:
            self._map()
            for pid in {*self.user_pid} - {0}:
                if not alive(pid):
                    self.dismiss(pid)
            if not any(self.user_pid):
                self.header[NOW] = START_NS  # that of killed processes is nobody's time
            self._user = self.take(self.user_pid, "process")
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
        for table, count in _TABLES.items():
            setattr(self, table, words[at : at + count])
            self._at[table] = at
            at += count
        self._names = memoryview(memory)[_WORDS * _WORD :]
        self._prepare()

    def _prepare(self) -> None:
        if self.header[0] == _VERSION:
            return
        self._memory[:] = bytes(_SIZE)  # a page of another version of this package
        for row in range(THREADS):
            self.until[row] = FOREVER
        for row in range(ENDS):
            self.waiter[row] = NOBODY
        self.header[NOW] = START_NS
        self.header[0] = _VERSION

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Lock the page: one thread of one process at a time takes and returns rows."""
        with self._lock:
            fcntl.flock(self._file, fcntl.LOCK_EX)
            try:
                yield
            finally:
                fcntl.flock(self._file, fcntl.LOCK_UN)

    # Header --------------------------------------------------------------------------------

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
        return self.header[ROSTER]

    @property
    def top(self) -> int:
        """Upper bound of the threads' rows in use."""
        return self.header[TOP] or THREADS

    @top.setter
    def top(self, top: int) -> None:
        self.header[TOP] = top

    @property
    def factor(self) -> float:
        """Simulated seconds per second of wall clock, over the last second or so."""
        return self.header[6] * 1e-3

    @factor.setter
    def factor(self, factor: float) -> None:
        self.header[6] = round(factor * 1e3)

    # Rows ----------------------------------------------------------------------------------

    def take(self, table: memoryview, what: str) -> int:
        """Take the first free row of `table` for this process, with the lock held.

        Raises TableFull.
        """
        try:
            row = table.tolist().index(0)
        except ValueError:
            raise TableFull(
                f"no room for one more {what} in simulated time: {len(table)} are there"
            ) from None
        table[row] = os.getpid()
        self.top = 0
        self.changed()
        return row

    def changed(self) -> None:
        """Notify everybody that the roster has changed."""
        self.header[ROSTER] += 1

    def name(self, thread: int) -> str:
        """Return the name of the thread in a row."""
        raw = bytes(self._names[thread * _NAME_BYTES : (thread + 1) * _NAME_BYTES])
        return raw.rstrip(b"\0").decode(errors="replace")

    def set_name(self, thread: int, name: str) -> None:
        """Name the thread in a row."""
        raw = name.encode()[:_NAME_BYTES].ljust(_NAME_BYTES, b"\0")
        self._names[thread * _NAME_BYTES : (thread + 1) * _NAME_BYTES] = raw

    def ends_of(self, channel: int) -> list[int]:
        """Return the rows of a channel's ends."""
        return [row for row, each in enumerate(self.channel.tolist()) if each == channel]

    def senders_to(self, end: int) -> list[int]:
        """Return the rows of the other ends of its channel that send."""
        others = self.ends_of(self.channel[end])
        return [row for row in others if row != end and self.sends[row]]

    def buses(self) -> list[tuple[int, int]]:
        """Return process and frames sent of each open bus: only there an end sends and receives.

        Of one within a process, whose channel is negative, the frames count as one.
        """
        rows = zip(self.end_pid, self.sent, self.sends, self.follows, self.channel, strict=True)
        return [
            (pid, sent) for pid, sent, sends, follows, channel in rows
            if (sends and follows) or channel < 0
        ]  # fmt: skip

    def dismiss(self, pid: int) -> None:
        """Return all rows of a process; the caller holds the lock."""
        for row in _rows(self.user_pid, pid):
            self.user_pid[row] = 0
        for row in _rows(self.thread_pid, pid):
            self.until[row] = FOREVER
            self.asleep[row] = self.thread_pid[row] = 0
        for row in _rows(self.end_pid, pid):
            self.leave(row)
        if self.conductor == pid:
            self.conductor = 0
        self.changed()

    def leave(self, end: int) -> None:
        """Return the row of an end; what nobody has taken is lost. The caller holds the lock."""
        others = self.ends_of(self.channel[end])
        self.follows[end] = self.sends[end] = self.channel[end] = self.end_pid[end] = 0
        self.waiter[end] = NOBODY
        for row in others:
            if row != end:
                self.taken[row] = sum(self.sent[each] for each in self.senders_to(row))
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

    def wake_thread(self, thread: int) -> None:
        """Wake a thread, if it sleeps."""
        self.wake[thread] += 1
        if self.asleep[thread]:
            self._wake(self._at["wake"] + thread)

    def sleep_thread(self, thread: int, seen: int, timeout_s: float) -> None:
        """Sleep until `wake` of the thread is no longer `seen`, or for `timeout_s`."""
        self.asleep[thread] = 1
        self._sleep(self._at["wake"] + thread, seen, timeout_s)
        self.asleep[thread] = 0

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
    """Return whether another thread of the process runs or waits for a core or a disk."""
    own = str(threading.get_native_id())
    for task in Path(f"/proc/{pid}/task").glob("*"):
        with suppress(OSError, IndexError):
            if task.name != own and _state(task) in "RD":
                return True
    return False


def _state(folder: Path) -> str:
    """Return the kernel's letter for the state of a process or thread, from its folder in /proc."""
    return (folder / "stat").read_text().rpartition(")")[2].split()[0]


def _rows(table: memoryview, pid: int) -> list[int]:
    return [row for row, each in enumerate(table.tolist()) if each == pid]


def _opened_and_locked(path: Path) -> int:
    """Open or create the file and lock it; retry if its last user is just removing it."""
    while True:
        file = os.open(path, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
        fcntl.flock(file, fcntl.LOCK_EX)
        with suppress(FileNotFoundError):
            if os.fstat(file).st_ino == os.stat(path).st_ino:
                _take_memory(file, path)
                return file
        os.close(file)


def _take_memory(file: int, path: Path) -> None:
    """Make the file as long as a page, with memory behind each byte of it.

    A file that is only made longer has no memory yet: in a full /dev/shm its first use would end
    the process (SIGBUS). Raises NoMemory and leaves nothing behind; the caller has locked the file.
    """
    if os.fstat(file).st_size >= _SIZE:
        return
    try:
        os.posix_fallocate(file, 0, _SIZE)
    except OSError as error:
        path.unlink()
        os.close(file)
        raise NoMemory(
            f"no shared memory for simulated time: {_SIZE} bytes in {path.parent} are wanted "
            f"({error.strerror}); remove what fills it (`ls -lS {path.parent}`), or simulate by "
            "wall clock (--wall-clock)"
        ) from None
