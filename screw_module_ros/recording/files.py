# SPDX-License-Identifier: Apache-2.0
"""Access to files of a bag, with checks: each may be damaged or not a regular file.

Opening a FIFO would block and a device may react, so everything except a regular file is refused
before it is opened. Files are read in blocks and not mapped into memory: if another process
truncated a mapped file, this process would end.
"""

from __future__ import annotations

import fcntl
import os
import signal
import stat
import time
from itertools import count
from pathlib import Path
from types import TracebackType

from .errors import BagBusyError, BagReadError

_BLOCK = 2**20  # B copied at a time
_OWNER_ONLY = 0o600  # mode of a file: a recording is a person's health data


class Source:
    """An open file for reading by position; a context manager. stamp, size [B]: when opened."""

    def __init__(self, path: Path):
        """Open `path` for reading. Raises BagReadError if it is not a readable file."""
        self.path = path
        try:
            refuse_special(path)
            self.descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise BagReadError(f"{path} cannot be read: {error.strerror}") from None
        self.stamp = _stamp(os.fstat(self.descriptor))
        self.size = os.fstat(self.descriptor).st_size

    def __enter__(self) -> Source:
        return self

    def __exit__(
        self, kind: type | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self.descriptor)

    def read(self, start: int, length: int) -> bytes:
        """Return at most `length` bytes from `start` on, fewer at the end of the file.

        Raises BagReadError if reading fails.
        """
        if not 0 <= start < self.size:
            return b""
        try:
            return os.pread(self.descriptor, min(length, self.size - start), start)
        except OSError as error:
            raise BagReadError(f"{self.path} cannot be read: {error.strerror}") from None

    def check_unchanged(self) -> None:
        """Raise BagBusyError if the file has changed since it was opened."""
        if _stamp(os.stat(self.path)) != self.stamp:
            raise BagBusyError(f"{self.path} has changed meanwhile: it was not modified")


def _stamp(status: os.stat_result) -> tuple[int, int, int]:
    return status.st_ino, status.st_size, status.st_mtime_ns


def refuse_special(path: Path) -> None:
    """Raise BagReadError for anything but a regular file, OSError if it does not exist."""
    try:
        regular = stat.S_ISREG(path.stat().st_mode)
    except FileNotFoundError:
        if path.is_symlink():
            raise BagReadError(f"{path} is a link to nothing") from None
        raise
    if not regular:
        raise BagReadError(f"{path} is not a file but a folder, FIFO or device")


def read_text(path: Path, limit: int) -> str:
    """Return a file's text of at most `limit` bytes.

    Raises BagReadError if it cannot be read, is longer, or is not UTF-8.
    """
    with Source(path) as source:
        if source.size > limit:
            raise BagReadError(f"{path} is larger than {limit} bytes")
        try:
            return source.read(0, limit).decode()
        except UnicodeDecodeError:
            raise BagReadError(f"{path} is not UTF-8 text") from None


def files_of(folder: Path) -> list[Path]:
    """Return the MCAP files of a bag in the order of recording.

    Hidden files are not its own: other systems add some when they copy, like `._NAME_0.mcap`.
    Raises BagReadError without any.
    """
    if not folder.exists():
        raise BagReadError(f"there is no bag {folder}")
    numbers = {}
    for path in folder.glob("*.mcap"):
        number = "" if path.name.startswith(".") else path.stem.rpartition("_")[2]
        if number.isdecimal() and number.isascii() and len(number) < 10:
            numbers[path] = int(number)
    if not numbers:
        raise BagReadError(f"{folder} is no bag folder: it holds no NAME_0.mcap")
    return sorted(numbers, key=lambda path: (numbers[path], path.name))


def check_at_rest(source: Source, quiet: float) -> None:
    """Raise BagBusyError if another process records, copies or has just changed this file.

    quiet: least time since the last change [s]; 0 = only check whether it is open for writing.
    """
    try:
        fcntl.flock(source.descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        fcntl.flock(source.descriptor, fcntl.LOCK_UN)
    except BlockingIOError:
        raise BagBusyError(f"{source.path} is being written by another process") from None
    except OSError:
        pass  # NFS locks only what is open for writing, as `McapFile` opens it; others nothing
    if _open_for_writing(source.descriptor):
        raise BagBusyError(f"{source.path} is being written by another process: still copied?")
    for path in (source.path, source.path.parent):
        age = time.time() - path.stat().st_mtime
        if 0 <= age < quiet:  # a negative age is due to a changed clock, not to a copy
            raise BagBusyError(
                f"{path} was changed {age:.0f} s ago, it may still be copied: when it is complete, "
                f"run: session recover {source.path.parent}"
            )


def _open_for_writing(descriptor: int) -> bool:
    """Whether any process has the file open for writing, in which case Linux grants no read lease.

    Also False if the file system or missing rights prevent the check.
    """
    try:
        # If a process opens the file now, the kernel signals us; SIGIO would end this process.
        fcntl.fcntl(descriptor, fcntl.F_SETSIG, signal.SIGURG)
        fcntl.fcntl(descriptor, fcntl.F_SETLEASE, fcntl.F_RDLCK)
        fcntl.fcntl(descriptor, fcntl.F_SETLEASE, fcntl.F_UNLCK)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def keep_beside(source: Source, start: int, end: int, name: str) -> Path:
    """Copy the bytes from `start` to `end` into a new file `name` beside `source`; return its path.

    An existing file with the same content is reused; otherwise the name gets a number. Raises
    OSError if writing fails, and removes the incomplete file.
    """
    for number in count(1):
        target = source.path.with_name(f"{name}_{number}" if number > 1 else name)
        try:
            file = open(target, "xb", opener=owner_only)
            break
        except FileExistsError:
            if _holds(target, source, start, end):  # from an earlier recovery that failed later
                return target
    try:
        with file:
            for position in range(start, end, _BLOCK):
                file.write(source.read(position, min(_BLOCK, end - position)))
            file.flush()
            os.fsync(file.fileno())
        sync_folder(target.parent)
    except BaseException:
        target.unlink()
        raise
    return target


def _holds(target: Path, source: Source, start: int, end: int) -> bool:
    try:
        with Source(target) as kept:
            return kept.size == end - start and all(
                kept.read(at, _BLOCK) == source.read(start + at, min(_BLOCK, kept.size - at))
                for at in range(0, kept.size, _BLOCK)
            )
    except BagReadError:
        return False


def owner_only(path: str, flags: int) -> int:
    """Open a file, an opener for `open`; a new one is the owner's alone, whatever the umask."""
    return os.open(path, flags, _OWNER_ONLY)


def write_all(descriptor: int, data: bytes, offset: int) -> None:
    """Write `data` at `offset`. Raises OSError, for instance on a full disk."""
    view = memoryview(data)
    while view:
        written = os.pwrite(descriptor, view, offset)
        view = view[written:]
        offset += written


def sync_folder(folder: Path) -> None:
    """Write a folder's directory entries to the disk."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_atomically(path: Path, text: str) -> None:
    """Replace `path` by `text` atomically: a reader sees the old or the new content."""
    temporary = path.with_name(f".{path.name}.new")
    temporary.unlink(missing_ok=True)  # never write through an existing file or link
    try:
        with open(temporary, "x", encoding="utf-8", opener=owner_only) as file:
            file.write(text)
        os.replace(temporary, path)
    except OSError:
        temporary.unlink(missing_ok=True)
        raise
