# SPDX-License-Identifier: Apache-2.0
"""Reads files with names from others: only regular files of bounded size.

Opening a FIFO blocks, reading a device may have effects or never end, and a large file fills the
memory.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path


class NotRegular(OSError):
    """The path is not a regular file, or the file is too large; `strerror` says which."""


def read_regular(path: str | Path, largest: int) -> bytes:
    """Return the content of a regular file of up to `largest` bytes.

    Raises OSError when it cannot be read, NotRegular when it is something else or larger.
    """
    _check(path, os.stat(path), largest)
    with open(path, "rb", opener=_without_waiting) as file:
        # The path may have been replaced since the check; the open file counts.
        _check(path, os.fstat(file.fileno()), largest)
        content = file.read(largest + 1)
    if len(content) > largest:
        raise _too_large(path, largest)
    return content


def _check(path: str | Path, status: os.stat_result, largest: int) -> None:
    if not stat.S_ISREG(status.st_mode):
        raise NotRegular(0, "not a file but a folder, FIFO or device", str(path))
    if status.st_size > largest:
        raise _too_large(path, largest)


def _too_large(path: str | Path, largest: int) -> NotRegular:
    return NotRegular(0, f"larger than {largest} bytes", str(path))


def _without_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_NONBLOCK | os.O_NOCTTY)
