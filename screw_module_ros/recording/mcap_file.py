# SPDX-License-Identifier: Apache-2.0
"""One MCAP file while it is written, with counts, times and a running hash."""

from __future__ import annotations

import errno
import hashlib
import os
from pathlib import Path
from typing import IO, Any, NamedTuple, cast

from mcap.writer import Writer

from ..files import owner_only

NO_TIME = 2**63 - 1
"""rosbag2's start time of a bag without messages [ns]."""
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""What a full disk says; somebody can make an end of it."""


class Message(NamedTuple):
    """One message.

    channel: of its topic, see `Bag.add_topic`. log_time: of reception [ns since the epoch].
    publish_time: of publication [ns since the epoch]. sequence: the publisher's message number, 0
    if unknown. data: CDR bytes, with the four bytes of encapsulation first.
    """

    channel: int
    log_time: int
    publish_time: int
    sequence: int
    data: bytes


class McapFile:
    """One MCAP file as `mcap.Writer` writes it, with counts, times and a running hash.

    size: with what waits for room on the disk [B]. safe: size after the last flush [B]. begin, end:
    first and last log time [ns]. held_reason: why the disk takes nothing at present, empty if it
    does. finished: whether the index was written.
    """

    def __init__(self, path: Path, chunk_size: int):
        self.path = path
        self._raw = open(path, "xb", buffering=0, opener=owner_only)
        self._sha = hashlib.sha256()
        self._waiting = bytearray()
        self.held_reason, self.finished = "", False
        self.size = self.safe = self.messages = 0
        self.begin = self.end = NO_TIME
        self.schemas: dict[tuple[str, str], int] = {}
        # It calls `write`, `tell` and `flush`.
        self.writer = Writer(cast(IO[bytes], self), chunk_size=chunk_size)

    def tell(self) -> int:
        """Return the size; `Writer` asks."""
        return self.size

    def write(self, data: bytes) -> None:
        """Write all of `data`; what a full disk does not take waits for the next attempt."""
        self._waiting += data
        self._sha.update(data)
        self.size += len(data)
        self._push()

    def _push(self) -> None:
        self.held_reason = ""
        while self._waiting:
            try:
                written = self._raw.write(self._waiting)  # a nearly full disk takes a part
            except OSError as error:
                if error.errno not in FULL:
                    raise
                self.held_reason = error.strerror or "the disk is full"
                return
            del self._waiting[:written]

    def flush(self) -> bool:
        """Bring everything to the disk; return whether it had room.

        Raises OSError, also if the file was deleted or moved.
        """
        self._push()
        if self.held_reason:
            return False
        os.fdatasync(self._raw.fileno())
        os.stat(self.path)
        self.safe = self.size
        return True

    def finish(self) -> None:
        """Write the index and the footer, once."""
        if not self.finished:
            self.finished = True
            self.writer.finish()

    def cut_back(self) -> None:
        """Remove what came after the last flush, which may be half a chunk."""
        if not self._raw.closed:
            self._waiting.clear()
            os.ftruncate(self._raw.fileno(), self.safe)

    @property
    def closed(self) -> bool:
        """Whether it was closed."""
        return self._raw.closed

    def close(self) -> None:
        """Close the file."""
        self._raw.close()

    def note_times(self, message: Message) -> None:
        """Count a message and extend the file's span of time."""
        time = message[1]
        self.begin = min(self.begin, time)
        self.end = max(self.end, time) if self.messages else time
        self.messages += 1

    def as_yaml(self) -> dict[str, Any]:
        """Return the file's entry in metadata.yaml."""
        return {
            "path": self.path.name,
            "starting_time": {"nanoseconds_since_epoch": self.begin},
            "duration": {"nanoseconds": self.end - self.begin},
            "message_count": self.messages,
        }

    @property
    def sha256(self) -> str:
        """The hash of everything written."""
        return self._sha.hexdigest()
