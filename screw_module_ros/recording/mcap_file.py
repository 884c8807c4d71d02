# SPDX-License-Identifier: Apache-2.0
"""Writes one MCAP file that is complete after every flush, also if the recorder is killed.

MCAP (https://mcap.dev/spec) has index and footer at the end; most readers refuse a file without
them. Here each flush writes the new chunks over the previous end of the file, followed immediately
by metadata, index and footer. On a full disk the previous end is restored, so the file stays
complete. Only a write torn by a power failure leaves an unfinished file, which `recovery.recover`
completes.
"""

from __future__ import annotations

import fcntl
import os
import struct
import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import zstandard
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from .errors import BagBusyError
from .files import owner_only, write_all
from .mcap_records import MAGIC, chunk_length, encoded, message_indexes, summary_section
from .storage import StorageSettings

PROFILE = "ros2"
LIBRARY = "screw_module_ros"
HEAD = MAGIC + encoded(Header(PROFILE, LIBRARY))

_MESSAGE = struct.Struct("<BQHIQQ")
_MESSAGE_FIXED = 22  # bytes of a message record's content before the data
_PENDING_LIMIT = 8 * 2**20  # B; with more pending data, closed chunks are written before a flush


class Message(NamedTuple):
    """One message of the file.

    channel: id from `McapFile.add_channel`.
    log_time: time of reception [ns since the epoch].
    publish_time: time of publication [ns since the epoch].
    sequence: the publisher's message number, 0 if unknown.
    data: CDR bytes, with the four bytes of encapsulation first.
    """

    channel: int
    log_time: int
    publish_time: int
    sequence: int
    data: bytes


class McapFile:
    """Writer of one MCAP file. Not thread-safe; `session.Session` gives it a thread of its own."""

    def __init__(self, path: Path, settings: StorageSettings, create: bool = True):
        """Open `path`; `create` a new file, else the caller restores the state of an old one.

        Raises OSError if the file cannot be opened, BagBusyError if another process writes it.
        """
        self.path = path
        self._settings = settings
        self._zstd = zstandard.ZstdCompressor(level=settings.compression_level)
        flags = os.O_RDWR | (os.O_CREAT | os.O_EXCL if create else 0)
        self.descriptor = owner_only(str(path), flags)
        self._lock()
        self.counts: dict[int, int] = {}
        self.start_time = 0
        self.end_time = 0
        self.data_end = 0
        self.saved = 0
        self.schemas: list[Schema] = []
        self.channels: list[Channel] = []
        self._unwritten: list[Schema | Channel] = []
        self._chunk_index = bytearray()
        self._chunks = 0
        self._chunk = bytearray()
        self._index: dict[int, list[int]] = {}
        self._pending = bytearray()
        self._tail = b""
        self.metadata: dict[str, dict[str, str]] = {}
        if create:
            self._pending += HEAD

    def _lock(self) -> None:
        try:
            fcntl.flock(self.descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(self.descriptor)
            if not isinstance(error, BlockingIOError):
                raise  # a file system without locks
            raise BagBusyError(f"{self.path} is being written by another process") from None

    @property
    def message_count(self) -> int:
        """Messages in closed chunks."""
        return sum(self.counts.values())

    @property
    def size(self) -> int:
        """Size of the file on the disk after the last flush [B]."""
        return self.data_end + len(self._tail)

    def add_schema(self, name: str, encoding: str, text: str) -> int:
        """Add a schema; return its id."""
        schema = Schema(id=len(self.schemas) + 1, data=text.encode(), encoding=encoding, name=name)
        self.schemas.append(schema)
        self._unwritten.append(schema)
        return schema.id

    def add_channel(self, topic: str, schema: int, metadata: dict[str, str]) -> int:
        """Add a channel for `topic` with messages in CDR; return its id."""
        number = len(self.channels) + 1
        channel = Channel(
            id=number, topic=topic, message_encoding="cdr", schema_id=schema, metadata=metadata
        )
        self.channels.append(channel)
        self._unwritten.append(channel)
        self.counts[number] = 0
        return number

    def extend(self, messages: Iterable[Message]) -> None:
        """Append messages; they reach the disk with the next `flush`."""
        limit = self._settings.chunk_size
        pack = _MESSAGE.pack
        for channel, log_time, publish_time, sequence, data in messages:
            if len(self._chunk) >= limit:
                self.close_chunk()
            if self._unwritten:
                self._declare()
            chunk = self._chunk
            entries = self._index.get(channel)
            if entries is None:
                entries = self._index[channel] = []
            entries.append(log_time)
            entries.append(len(chunk))
            chunk += pack(
                5,
                _MESSAGE_FIXED + len(data),
                channel,
                sequence & 0xFFFFFFFF,
                log_time,
                publish_time,
            )
            chunk += data
        self.write_early()

    def _declare(self) -> None:
        """Write new schemas and channels before the first message that may need them."""
        self._chunk += encoded(*self._unwritten)
        self._unwritten.clear()

    def close_chunk(self) -> None:
        """Close the current chunk, so that the counts include every message."""
        if not self._index:
            return
        records = bytes(self._chunk)
        compressed = self._settings.compression == "zstd"
        times = [time for entries in self._index.values() for time in entries[::2]]
        chunk = Chunk(
            compression="zstd" if compressed else "",
            data=self._zstd.compress(records) if compressed else records,
            message_start_time=min(times),
            message_end_time=max(times),
            uncompressed_crc=zlib.crc32(records),
            uncompressed_size=len(records),
        )
        self.keep(chunk, self._index)
        self._chunk = bytearray()
        self._index = {}

    def _note_chunk(self, chunk: Chunk, offset: int, index: Mapping[int, list[int]]) -> bytes:
        """Count a chunk at `offset`; return the message indexes that follow it.

        index: per channel, log time [ns] and offset in the chunk of each message, alternating.
        """
        start = end = offset + chunk_length(chunk)
        indexes = message_indexes(index)
        offsets = {}
        for channel, entries in index.items():
            offsets[channel] = end
            end += 15 + 8 * len(entries)
            self.counts[channel] = self.counts.get(channel, 0) + len(entries) // 2
        first = chunk.message_start_time
        self.start_time = min(self.start_time, first) if self._chunks else first
        self.end_time = max(self.end_time, chunk.message_end_time)
        self._chunks += 1
        entry = ChunkIndex(
            chunk_length=start - offset,
            chunk_start_offset=offset,
            compression=chunk.compression,
            compressed_size=len(chunk.data),
            message_end_time=chunk.message_end_time,
            message_index_length=len(indexes),
            message_index_offsets=offsets,
            message_start_time=first,
            uncompressed_size=chunk.uncompressed_size,
        )
        self._chunk_index += encoded(entry)
        return indexes

    def declare(self, schemas: Iterable[Schema], channels: Iterable[Channel], write: bool) -> None:
        """Set declarations with their ids, for recovery; `write`: also before the chunks."""
        self.schemas, self.channels = list(schemas), list(channels)
        self.counts = {channel.id: self.counts.get(channel.id, 0) for channel in self.channels}
        if write:
            self._pending += encoded(*self.schemas, *self.channels)

    def resume(self, chunk: Chunk, offset: int, index: Mapping[int, list[int]]) -> None:
        """Continue after an existing chunk at `offset`, with its indexes; for recovery."""
        self._pending = bytearray(self._note_chunk(chunk, offset, index))
        self.data_end = offset + chunk_length(chunk)

    def keep(self, chunk: Chunk, index: Mapping[int, list[int]]) -> None:
        """Append a complete chunk; it stays in memory until `flush` or `write_early`."""
        offset = self.data_end + len(self._pending)
        self._pending += encoded(chunk)
        self._pending += self._note_chunk(chunk, offset, index)

    def write_early(self) -> None:
        """Write closed chunks to the disk if they exceed a limit. Raises OSError like `flush`."""
        if len(self._pending) > _PENDING_LIMIT:
            self._write()

    def flush(self) -> None:
        """Write everything to the disk as a complete file with `metadata`.

        Raises OSError if it cannot be written; the file then keeps its previous state.
        """
        self.close_chunk()
        self._write()

    def _write(self) -> None:
        end = self.data_end + len(self._pending)
        tail = self._tail_at(end)
        try:
            write_all(self.descriptor, bytes(self._pending) + tail, self.data_end)
            os.ftruncate(self.descriptor, end + len(tail))
            os.fdatasync(self.descriptor)
        except OSError:
            self._put_back()
            raise
        self.data_end, self._tail = end, tail
        self._pending = bytearray()
        self.saved = self.message_count

    def _put_back(self) -> None:
        """Restore the previous end; its blocks are still allocated, so this needs no space."""
        write_all(self.descriptor, self._tail, self.data_end)
        os.ftruncate(self.descriptor, self.data_end + len(self._tail))

    def _tail_at(self, base: int) -> bytes:
        data = indexes = b""
        for name, values in self.metadata.items():
            record = encoded(Metadata(name=name, metadata=values))
            index = MetadataIndex(offset=base + len(data), length=len(record), name=name)
            data += record
            indexes += encoded(index)
        data += encoded(DataEnd(0))
        groups = {
            Opcode.SCHEMA: encoded(*self.schemas),
            Opcode.CHANNEL: encoded(*self.channels),
            Opcode.STATISTICS: encoded(self._statistics()),
            Opcode.CHUNK_INDEX: bytes(self._chunk_index),
            Opcode.METADATA_INDEX: indexes,
        }
        return data + summary_section(groups, base + len(data))

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=0,
            channel_count=len(self.channels),
            channel_message_counts=self.counts,
            chunk_count=self._chunks,
            message_count=self.message_count,
            message_end_time=self.end_time,
            message_start_time=self.start_time,
            metadata_count=len(self.metadata),
            schema_count=len(self.schemas),
        )

    def close(self) -> None:
        """Close the file without a flush."""
        if self.descriptor >= 0:
            os.close(self.descriptor)
            self.descriptor = -1
