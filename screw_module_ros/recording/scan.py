# SPDX-License-Identifier: Apache-2.0
"""Walks through the chunks of an MCAP file of this recorder, finished or cut off.

Readers of libraries want index and footer; repairing and auditing a bag must do without.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import NamedTuple

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Header, Metadata, Schema

from .errors import BagReadError
from .mcap_file import LIBRARY, Message
from .mcap_records import FOOTER_BYTES, MAGIC

_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")


class ScannedChunk(NamedTuple):
    """One whole chunk.

    offset, end: where it stands in the file, message indexes not included [B].
    chunk: as stored. schemas, channels: declared in it. messages: in it.
    index: per channel, log time [ns] and offset in the chunk of each message, alternating.
    """

    offset: int
    end: int
    chunk: Chunk
    schemas: list[Schema]
    channels: list[Channel]
    messages: list[Message]
    index: dict[int, list[int]]


def data_start(buffer: memoryview) -> int:
    """Return where the data of the file begins.

    Raises BagReadError when this is no MCAP file of this recorder.
    """
    if bytes(buffer[: len(MAGIC)]) != MAGIC:
        raise BagReadError("no MCAP file: the first bytes are not those of one")
    record = _record_at(buffer, len(MAGIC))
    if record is None or record[0] != Opcode.HEADER:
        raise BagReadError("no MCAP file: it has no header")
    library = Header.read(_stream(buffer, record)).library
    if library != LIBRARY:
        raise BagReadError(f"recorded by {library!r}, not by this recorder: try `mcap recover`")
    return record[2]


def chunks(buffer: memoryview, position: int) -> Iterator[ScannedChunk]:
    """Yield the whole chunks from `position` on; end at the first thing that is none."""
    while True:
        record = _record_at(buffer, position)
        if record is None or record[0] not in (Opcode.CHUNK, Opcode.MESSAGE_INDEX):
            return
        if record[0] == Opcode.CHUNK:
            found = _chunk(buffer, position, record)
            if found is None:
                return
            yield found
        position = record[2]


def metadata_records(buffer: memoryview, position: int) -> dict[str, dict[str, str]]:
    """Return the metadata records of a complete file from `position` on, by name."""
    found = {}
    while (record := _record_at(buffer, position)) is not None and record[0] != Opcode.FOOTER:
        if record[0] == Opcode.METADATA:
            metadata = Metadata.read(_stream(buffer, record))
            found[metadata.name] = metadata.metadata
        position = record[2]
    return found


def is_complete(buffer: memoryview) -> bool:
    """Whether the file has its footer and the index before it is sound."""
    start = len(buffer) - FOOTER_BYTES
    if start < len(MAGIC) or bytes(buffer[-len(MAGIC) :]) != MAGIC:
        return False
    opcode, length, summary, offsets, crc = struct.unpack_from("<BQQQI", buffer, start)
    if opcode != Opcode.FOOTER or length != 20 or not summary <= offsets <= start:
        return False
    return zlib.crc32(buffer[summary : start + _RECORD.size + 16]) == crc


def _record_at(buffer: memoryview, position: int) -> tuple[int, int, int] | None:
    """Return (opcode, start of the content, end) of a record, None when it is cut off."""
    start = position + _RECORD.size
    if start > len(buffer):
        return None
    opcode, length = _RECORD.unpack_from(buffer, position)
    return (opcode, start, start + length) if start + length <= len(buffer) else None


def _stream(buffer: memoryview, record: tuple[int, int, int]) -> ReadDataStream:
    return ReadDataStream(BytesIO(buffer[record[1] : record[2]]))


def _chunk(buffer: memoryview, position: int, record: tuple[int, int, int]) -> ScannedChunk | None:
    try:
        chunk = Chunk.read(_stream(buffer, record))
        data = chunk.data
        if chunk.compression == "zstd":
            data = zstandard.decompress(data, chunk.uncompressed_size)
    except (McapError, zstandard.ZstdError, struct.error, UnicodeDecodeError, MemoryError):
        return None
    if len(data) != chunk.uncompressed_size or zlib.crc32(data) != chunk.uncompressed_crc:
        return None
    found = ScannedChunk(position, record[2], chunk, [], [], [], {})
    _unpack(data, found)
    return found


def _unpack(data: bytes, found: ScannedChunk) -> None:
    position = 0
    while position < len(data):
        opcode, length = _RECORD.unpack_from(data, position)
        start = position + _RECORD.size
        end = start + length
        if opcode == Opcode.MESSAGE:
            channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(data, start)
            content = data[start + _MESSAGE.size : end]
            found.messages.append(Message(channel, log_time, publish_time, sequence, content))
            found.index.setdefault(channel, []).extend((log_time, position))
        elif opcode == Opcode.SCHEMA:
            found.schemas.append(Schema.read(ReadDataStream(BytesIO(data[start:end]))))
        elif opcode == Opcode.CHANNEL:
            found.channels.append(Channel.read(ReadDataStream(BytesIO(data[start:end]))))
        position = end
