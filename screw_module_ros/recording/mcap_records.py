# SPDX-License-Identifier: Apache-2.0
"""Parts of an MCAP file as bytes: records, and the end with index and footer."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Chunk, Footer, McapRecord, SummaryOffset

MAGIC = b"\x89MCAP0\r\n"
FOOTER_BYTES = 9 + 20 + len(MAGIC)


def chunk_head(chunk: Chunk) -> bytes:
    """Return the bytes of a chunk's record up to its data."""
    name = chunk.compression.encode()
    return (
        struct.pack(
            "<BQQQQII",
            Opcode.CHUNK,
            chunk_length(chunk) - 9,
            chunk.message_start_time,
            chunk.message_end_time,
            chunk.uncompressed_size,
            chunk.uncompressed_crc,
            len(name),
        )
        + name
        + struct.pack("<Q", len(chunk.data))
    )


def message_indexes(index: Mapping[int, list[int]]) -> bytes:
    """Return the message indexes of a chunk.

    index: per channel, log time [ns] and offset in the chunk of each message, alternating.
    """
    found = bytearray()
    for channel, entries in index.items():
        size = 8 * len(entries)
        found += struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + size, channel, size)
        found += struct.pack(f"<{len(entries)}Q", *entries)
    return bytes(found)


def chunk_length(chunk: Chunk) -> int:
    """Return the length of a chunk's whole record [B]."""
    return 9 + 8 + 8 + 8 + 4 + 4 + len(chunk.compression) + 8 + len(chunk.data)


def encoded(*records: McapRecord) -> bytes:
    """Return the bytes of records, one after the other."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()


def summary_section(groups: Mapping[Opcode, bytes], start: int) -> bytes:
    """Return summary, summary offsets, footer and magic of a summary at the offset `start`."""
    summary = b"".join(groups.values())
    offsets = b""
    position = start
    for opcode, group in groups.items():
        if group:
            offsets += encoded(SummaryOffset(opcode, position, len(group)))
        position += len(group)
    summary += offsets
    fields = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, position)
    footer = Footer(
        summary_start=start,
        summary_offset_start=position,
        summary_crc=zlib.crc32(fields, zlib.crc32(summary)),
    )
    return summary + encoded(footer) + MAGIC
