# SPDX-License-Identifier: Apache-2.0
"""What other readers find in a bag: the mcap library, rosbags, a plain scan for whole chunks.

Nothing of the recorder's own code is used here.
"""

from __future__ import annotations

import contextlib
import io
import struct
import zlib
from pathlib import Path

import zstandard
from mcap.records import Message as Record
from mcap.stream_reader import StreamReader
from rosbags.highlevel import AnyReader


def by_library(content: bytes) -> int:
    """Count the messages the mcap library reads up to its first error."""
    total = 0
    with contextlib.suppress(Exception):
        for record in StreamReader(io.BytesIO(content), validate_crcs=True).records:
            total += isinstance(record, Record)
    return total


def sequences(folder: Path) -> list[int]:
    """Return the sequence of each message that rosbags reads; it follows a stamp."""
    with AnyReader([folder]) as reader:
        return [int.from_bytes(data[12:16], "little") for _, _, data in reader.messages()]


def by_scan(content: bytes) -> list[tuple[int, bytes]]:
    """Return (channel, data) of the messages in every intact chunk, wherever it stands."""
    found: list[tuple[int, bytes]] = []
    place = content.find(b"\x06")
    while 0 <= place < len(content) - 49:
        end, messages = intact_chunk(content, place)
        found += messages
        place = content.find(b"\x06", end or place + 1)
    return found


def intact_chunk(content: bytes, place: int) -> tuple[int, list[tuple[int, bytes]]]:
    _, length, _, _, size, crc, name = struct.unpack_from("<BQQQQII", content, place)
    end = place + 9 + length
    if end > len(content) or name not in (0, 4) or length < 40 + name or size > 10**6:
        return 0, []
    data = content[place + 49 + name : end]
    if not name and content[place + 41 : place + 49] != struct.pack("<Q", len(data)):
        return 0, []
    if name:
        try:
            data = zstandard.decompress(data, size)
        except (zstandard.ZstdError, MemoryError):
            return 0, []
    if zlib.crc32(data) != crc or not data:
        return 0, []
    found, at = [], 0
    while at < len(data):
        opcode, length = struct.unpack_from("<BQ", data, at)
        if opcode == 5:
            channel = struct.unpack_from("<H", data, at + 9)[0]
            found.append((channel, data[at + 31 : at + 9 + length]))
        at += 9 + length
    return end, found
