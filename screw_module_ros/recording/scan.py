# SPDX-License-Identifier: Apache-2.0
"""Scans an MCAP file of this recorder, which may be whole, cut off or damaged anywhere.

The readers of libraries need index and footer; repair and audit work without them. A chunk is whole
if its records match their checksum. All its other data (lengths, times, the message indexes after
it) follow from the records, and damage to them does not lose the records.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import NamedTuple

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Header, McapRecord, Metadata, Schema

from .errors import BagReadError
from .files import Source
from .mcap_file import HEAD, LIBRARY, Message
from .mcap_records import FOOTER_BYTES, MAGIC, chunk_head, chunk_length, message_indexes

_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_CHUNK = struct.Struct("<BQQQQII")  # opcode, length, times, size, CRC, length of compression
_LENGTH = struct.Struct("<Q")
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_CANDIDATE = re.compile(rb"(?s)\x06.{4}\x00{4}.{28}[\x00\x04]\x00{3}")
_LOOK_AHEAD = 64  # B, more than a chunk's header
_BLOCK = 2**20  # B searched at a time
_MOST = 2**30  # B; largest length of a chunk or of a record outside of chunks
_MOST_RATIO = 2**15  # zstd: a block of 128 KiB takes at least 4 bytes
_FEW = 4  # different bytes of a damaged header; that of another recorder differs in more
_MALFORMED = (McapError, struct.error, ValueError, OverflowError, MemoryError)
_KINDS = (Opcode.SCHEMA, Schema), (Opcode.CHANNEL, Channel), (Opcode.METADATA, Metadata)
_OUTSIDE = {opcode: kind.read for opcode, kind in _KINDS}


class ScannedChunk(NamedTuple):
    """One whole chunk.

    offset: in the file [B]. end: of the chunk and of the indexes after it [B]. chunk: its correct
    content. schemas, channels: declared in it. messages: in it. index: per channel, log time [ns]
    and offset in the chunk of each message, alternating. sound: whether its head is undamaged.
    indexed: whether its indexes are undamaged.
    """

    offset: int
    end: int
    chunk: Chunk
    schemas: list[Schema]
    channels: list[Channel]
    messages: list[Message]
    index: dict[int, list[int]]
    sound: bool
    indexed: bool = True


class Damage(NamedTuple):
    """Unreadable bytes of the file, from `start` to `end`."""

    start: int
    end: int


class Outside(NamedTuple):
    """A record outside of the chunks: opcode, end [B], content if its type is decoded."""

    opcode: int
    end: int
    record: McapRecord | None


def has_sound_head(source: Source, vouched: bool) -> bool:
    """Whether the file has this recorder's header; False if the header is damaged.

    vouched: whether other evidence, like metadata.yaml, shows that this recorder wrote the file.
    Raises BagReadError if another program wrote it.
    """
    head = source.read(0, len(HEAD))
    if head == HEAD:
        return True
    if len(head) == len(HEAD) and sum(a != b for a, b in zip(head, HEAD, strict=True)) <= _FEW:
        return False
    library = _library(source)
    if library and library != LIBRARY:
        other = f"recorded by {library[:80]!r}, not by this recorder: try `mcap recover`"
        raise BagReadError(f"{source.path}: {other}")
    if not vouched:
        raise BagReadError(f"{source.path}: not an MCAP file: its first bytes are not MCAP's magic")
    return False


def _library(source: Source) -> str:
    if source.read(0, len(MAGIC)) != MAGIC:
        return ""
    opcode, start, end = _record_at(source, len(MAGIC)) or (0, 0, 0)
    try:
        return Header.read(_stream(source.read(start, end - start))).library if opcode == 1 else ""
    except _MALFORMED:
        return ""


def parts(source: Source) -> Iterator[ScannedChunk | Damage]:
    """Yield whole chunks and damaged parts, from the first chunk to the end of the last.

    An undamaged end of the file (metadata, index, footer) is not yielded.
    """
    summary = summary_start(source)
    position = data_start(source)
    while position < source.size:
        found = chunk_at(source, position)
        if found is None:
            if _is_end(source, position, summary):
                return
            behind = _next_chunk(source, position + 1)
            yield Damage(position, behind)
            position = behind
            continue
        indexes = message_indexes(found.index)
        if source.read(found.end, len(indexes)) == indexes:
            found = found._replace(end=found.end + len(indexes))
        else:
            expected, found = found.end + len(indexes), found._replace(indexed=False)
            if chunk_at(source, expected) or _is_end(source, expected, summary):
                found = found._replace(end=expected)
        yield found
        position = found.end


def data_start(source: Source) -> int:
    """Return the expected offset of the first chunk: after the header and its declarations.

    It is 0 if the header is damaged and its length is unknown: the scan then searches from there.
    """
    end = len(HEAD)
    if source.read(0, end) != HEAD and chunk_at(source, end) is None:
        return 0
    for found in outside(source, end):
        if found.opcode not in (Opcode.SCHEMA, Opcode.CHANNEL):
            break
        end = found.end
    return end


def outside(source: Source, position: int) -> Iterator[Outside]:
    """Yield the records from `position` on, up to the footer or a malformed record."""
    while (place := _record_at(source, position)) is not None:
        opcode, start, position = place
        if opcode in (0, Opcode.FOOTER):
            return
        read, record = _OUTSIDE.get(opcode), None
        if read is not None:
            try:
                record = read(_stream(source.read(start, position - start)))
            except _MALFORMED:
                return
        yield Outside(opcode, position, record)


def summary_start(source: Source) -> int:
    """Return the offset of the index, -1 if it or the footer is damaged: the file is torn."""
    start = source.size - FOOTER_BYTES
    footer = source.read(start, FOOTER_BYTES)
    if start < len(HEAD) or footer[-len(MAGIC) :] != MAGIC:
        return -1
    opcode, length, summary, offsets, crc = struct.unpack_from("<BQQQI", footer)
    if opcode != Opcode.FOOTER or length != 20 or not 0 < summary <= offsets <= start:
        return -1
    found = 0
    for position in range(summary, start, _BLOCK):
        found = zlib.crc32(source.read(position, min(_BLOCK, start - position)), found)
    return summary if zlib.crc32(footer[: _RECORD.size + 16], found) == crc else -1


def _is_end(source: Source, position: int, summary: int) -> bool:
    """Whether only metadata lie between `position` and an undamaged index."""
    if summary < 0:
        return False
    for found in outside(source, position):
        if found.opcode == Opcode.DATA_END:
            return found.end == summary
        if found.opcode != Opcode.METADATA:
            return False
    return False


def _record_at(source: Source, position: int) -> tuple[int, int, int] | None:
    """Return (opcode, start of the content, end) of a record, None if it is cut off."""
    head = source.read(position, _RECORD.size)
    if len(head) < _RECORD.size:
        return None
    opcode, length = _RECORD.unpack(head)
    start = position + _RECORD.size
    return (opcode, start, start + length) if length <= min(_MOST, source.size - start) else None


def _stream(content: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(content))


def _next_chunk(source: Source, position: int) -> int:
    """Return the offset of the next whole chunk, the end of the file without one."""
    while position < source.size:
        block = source.read(position, _BLOCK + _LOOK_AHEAD)
        place = 0
        while (match := _CANDIDATE.search(block, place)) and match.start() < _BLOCK:
            place = match.start() + 1
            if _promising(block, match.start()) and chunk_at(source, position + match.start()):
                return position + match.start()
        position += _BLOCK
    return source.size


def _promising(block: bytes, place: int) -> bool:
    """Whether a candidate can be a chunk: many bytes resemble the head of one."""
    _, length, _, _, _, _, name = _CHUNK.unpack_from(block, place)
    start = place + _CHUNK.size + name
    if name:
        return block.startswith(_ZSTD_MAGIC, start + _LENGTH.size)
    return len(block) >= start + 8 and length == 40 + _LENGTH.unpack_from(block, start)[0]


def chunk_at(source: Source, position: int) -> ScannedChunk | None:
    """Return the chunk at `position`, without its indexes; None if it is not whole.

    Damage to its opcode, times, compression, size or one of its two lengths is corrected.
    """
    head = source.read(position, _LOOK_AHEAD)
    if len(head) < _CHUNK.size + 12:
        return None
    _, length, _, _, _, crc, _ = _CHUNK.unpack_from(head)
    for compression in ("zstd", ""):
        start = _CHUNK.size + len(compression)
        (stated,) = _LENGTH.unpack_from(head, start)
        start += position + _LENGTH.size
        for size in dict.fromkeys((stated, length - 40 - len(compression))):
            if not 0 < size <= min(_MOST, source.size - start):
                continue
            data = source.read(start, size)
            records = _uncompressed(data) if compression else data
            if records is not None and zlib.crc32(records) == crc:
                chunk = Chunk(compression, data, 0, 0, crc, len(records))
                return _scanned(position, head, chunk, records)
    return None


def _uncompressed(data: bytes) -> bytes | None:
    try:
        # The frame states its size, as the chunk's may be damaged; impossible sizes are refused.
        if not 0 < zstandard.frame_content_size(data) <= min(_MOST, _MOST_RATIO * len(data)):
            return None
        return zstandard.ZstdDecompressor().decompress(data, allow_extra_data=False)
    except (zstandard.ZstdError, MemoryError):
        return None


def _scanned(position: int, head: bytes, chunk: Chunk, records: bytes) -> ScannedChunk | None:
    try:
        schemas, channels, messages, index = _unpacked(records)
    except _MALFORMED:
        return None
    if not messages:
        return None
    times = [message.log_time for message in messages]
    chunk.message_start_time, chunk.message_end_time = min(times), max(times)
    end = position + chunk_length(chunk)
    sound = head.startswith(chunk_head(chunk))
    return ScannedChunk(position, end, chunk, schemas, channels, messages, index, sound)


def _unpacked(
    records: bytes,
) -> tuple[list[Schema], list[Channel], list[Message], dict[int, list[int]]]:
    schemas, channels, messages = [], [], []
    index: dict[int, list[int]] = {}
    position = 0
    while position < len(records):
        opcode, length = _RECORD.unpack_from(records, position)
        start = position + _RECORD.size
        end = start + length
        if end > len(records):
            raise ValueError("a record is longer than its chunk")
        if opcode == Opcode.MESSAGE:
            channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(records, start)
            content = records[start + _MESSAGE.size : end]
            messages.append(Message(channel, log_time, publish_time, sequence, content))
            index.setdefault(channel, []).extend((log_time, position))
        elif opcode == Opcode.SCHEMA:
            schemas.append(Schema.read(_stream(records[start:end])))
        elif opcode == Opcode.CHANNEL:
            channels.append(Channel.read(_stream(records[start:end])))
        position = end
    return schemas, channels, messages, index
