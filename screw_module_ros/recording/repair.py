# SPDX-License-Identifier: Apache-2.0
"""Repairs one damaged MCAP file from its whole chunks."""

from __future__ import annotations

import contextlib
import os
import shutil
from types import TracebackType

from mcap.records import Schema

from .bag import AUDIT, PREFIX
from .catalogue import Declarations
from .files import Source
from .mcap_file import HEAD, McapFile
from .noted import Noted
from .scan import ScannedChunk
from .storage import StorageSettings
from .survey import Survey


class Repair:
    """A file under repair; a context manager. Without `finish` the file stays unchanged.

    If only the end is torn, it is cut off in place. Else the chunks are written to a new file,
    which replaces the old one: moving chunks in place could lose them in a power failure.
    """

    def __init__(self, source: Source, found: Survey, channels: Declarations):
        """Open the file for writing. Raises OSError, BagBusyError."""
        self.path = source.path
        self._in_place = found.orderly and all(damage.end == source.size for damage in found.cut)
        target = self.path
        if not self._in_place:
            target = self.path.with_name(f".{self.path.name}.new")
            target.unlink(missing_ok=True)
        self._file = McapFile(target, StorageSettings(), create=not self._in_place)
        schemas: dict[int, Schema] = {d.schema.id: d.schema for d in channels.values()}
        self._file.declare(
            schemas.values(), (d.channel for d in channels.values()), write=not self._in_place
        )
        if self._in_place:
            self._file.data_end = len(HEAD)

    def __enter__(self) -> Repair:
        return self

    def __exit__(
        self, kind: type | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()
        if not self._in_place:
            with contextlib.suppress(FileNotFoundError):  # it has replaced the old one
                self._file.path.unlink()

    def take(self, found: ScannedChunk) -> None:
        """Keep a whole chunk, in order. Raises OSError if writing fails."""
        if self._in_place:
            self._file.resume(found.chunk, found.offset, found.index)
        else:
            self._file.keep(found.chunk, found.index)
            self._file.write_early()

    def finish(self, information: str, noted: Noted) -> None:
        """Write metadata, index and footer after the chunks. Raises OSError if writing fails.

        information: of the whole bag, as text of metadata.yaml; noted: the same as an object.
        """
        self._file.metadata = {
            "rosbag2": {"serialized_metadata": information},
            AUDIT: {topic.name: noted.audit(topic.name).as_text() for topic in noted.topics},
            **{PREFIX + name: values for name, values in noted.sections.items()},
        }
        self._file.flush()
        if not self._in_place:
            shutil.copymode(self.path, self._file.path)
            with contextlib.suppress(PermissionError):  # only root may change the owner
                status = self.path.stat()
                os.chown(self._file.path, status.st_uid, status.st_gid)
            os.replace(self._file.path, self.path)
