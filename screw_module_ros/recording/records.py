# SPDX-License-Identifier: Apache-2.0
"""Reads the records of a bag's files in any state.

`File` reads an MCAP file with the mcap library's records, whether it is whole, cut off or damaged:
a damaged record is skipped by its length, and reading ends at the first broken length. A chunk is
whole if its content matches its checksum (0: none was given).
"""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import yaml
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Header, Message, Metadata, Schema, Statistics
from mcap.stream_reader import get_chunk_data_stream

from .bag import METADATA_FILE, PREFIX, BagError, Topic
from .definitions import Definition

LARGEST = 100 * 2**20
"""Largest record or uncompressed chunk that is read [B]: memory stays below ten times as much."""
_MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")  # opcode and length of a record
_FOOTER = struct.Struct("<BQQQI")  # the same, start of the index and of its offsets, checksum
_DECLARATIONS: dict[int, Any] = {Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel}
_NOTES: dict[int, Any] = {Opcode.METADATA: Metadata}
_DATA: dict[int, Any] = {
    Opcode.HEADER: Header, Opcode.CHUNK: Chunk, Opcode.STATISTICS: Statistics, **_NOTES
}  # fmt: skip


def files_of(bag: Path | str) -> list[Path]:
    """Return the MCAP files of a bag in the order of recording. Raises BagError without any.

    Hidden files are not its own: other systems add some when they copy, like `._NAME_0.mcap`.
    """
    found = {}
    for path in Path(bag).glob("[!.]*.mcap"):
        number = path.stem.rpartition("_")[2]
        if number.isdecimal():
            found[path] = int(number)
    if not Path(bag).exists():
        raise BagError(f"there is no bag {bag}")
    if not found:
        raise BagError(f"{bag} is no bag folder: it holds no NAME_0.mcap")
    return sorted(found, key=lambda path: (found[path], path.name))


def information(bag: Path | str) -> dict[str, Any]:
    """Return the content of metadata.yaml, empty without the file. Raises BagError.

    `custom_data`, `relative_file_paths` and `topics_with_message_count` are there if it is one.
    """
    path = Path(bag) / METADATA_FILE
    try:
        found = dict(yaml.safe_load(path.read_text("utf-8"))["rosbag2_bagfile_information"])
        found["custom_data"] = dict(found.get("custom_data") or {})
        found["relative_file_paths"] = [str(name) for name in found["relative_file_paths"]]
        found["topics_with_message_count"] = {
            line["topic_metadata"]["name"]: line["message_count"]
            for line in found["topics_with_message_count"]
        }
        return found
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, TypeError, KeyError, RecursionError, yaml.YAMLError) as error:
        raise BagError(f"{METADATA_FILE} cannot be read: {type(error).__name__}") from None


def notes(bag: Path | str) -> dict[str, dict[str, str]]:
    """Return the recorder's notes: parameters, configuration, counts and so on, by name.

    Bags of older versions have them in metadata.yaml too. Raises BagError.
    """
    return noted(information(bag), map(File, files_of(bag)))


def noted(told: Mapping[str, Any], files: Iterable[File]) -> dict[str, dict[str, str]]:
    """Return the notes in the content `told` of metadata.yaml and in files; the last ones count."""
    found = {}
    for name, text in told.get("custom_data", {}).items():
        if name.startswith(PREFIX) and str(text).startswith("{"):
            found[name.removeprefix(PREFIX)] = decoded(text)
    for file in files:
        found |= file.notes()
    return found


def decoded(text: Any) -> dict[str, Any]:
    """Return the mapping in a JSON text, empty if it is none; a mapping as it is."""
    try:
        found = text if isinstance(text, dict) else json.loads(text)
    except (ValueError, TypeError, RecursionError):
        found = {}
    return found if isinstance(found, dict) else {}


class File:
    """One MCAP file in any state. Raises BagError if the disk cannot be read.

    topics: by channel; problems: sentences; stated: number of messages by its index, None without
    one: all are complete once `messages` has ended.
    """

    def __init__(self, path: Path):
        self.path = path
        self.topics: dict[int, Topic] = {}
        self.problems: list[str] = []
        self.stated: int | None = None
        self._schemas: dict[int, Schema] = {}

    def notes(self) -> dict[str, dict[str, str]]:
        """Return the recorder's notes in the readable part, by name; the last ones count."""
        with self._opened() as (file, end):
            found = _records(file, len(_MAGIC), end, _NOTES)
            return {
                record.name.removeprefix(PREFIX): dict(record.metadata)
                for record in found
                if isinstance(record, Metadata) and record.name.startswith(PREFIX)
            }

    def messages(self) -> Iterator[tuple[Topic, Message]]:
        """Yield the messages of every whole chunk."""
        with self._opened() as (file, end):
            file.seek(0)
            if file.read(len(_MAGIC)) != _MAGIC:
                self.problems.append(f"{self.path.name}: its first bytes are not those of MCAP")
            self._read_index(file, end)
            undeclared = 0
            for record in _records(file, len(_MAGIC), end, _DATA):
                if isinstance(record, Statistics):
                    self.stated = record.message_count
                for found in _unpacked(record) if isinstance(record, Chunk) else (record,):
                    if isinstance(found, BagError):
                        self.problems.append(f"{self.path.name}: {found}")
                    elif not isinstance(found, Message):
                        self._declare(found)
                    elif found.channel_id in self.topics:
                        yield self.topics[found.channel_id], found
                    else:
                        undeclared += 1
            if undeclared:
                told = f"{undeclared} messages of topics whose declaration is damaged"
                self.problems.append(f"{self.path.name}: {told}")

    @contextmanager
    def _opened(self) -> Iterator[tuple[IO[bytes], int]]:
        """Open the file; return it with the end of its records."""
        try:
            with open(self.path, "rb") as file:
                size = os.fstat(file.fileno()).st_size
                file.seek(max(0, size - len(_MAGIC)))
                yield file, size - len(_MAGIC) if file.read() == _MAGIC else size
        except OSError as error:
            raise BagError(f"{self.path.name} cannot be read: {error.strerror}") from None

    def _read_index(self, file: IO[bytes], end: int) -> None:
        """Take the declarations of the index, which is whole by its checksum, or a problem."""
        place = end - _FOOTER.size
        file.seek(max(0, place))
        tail = file.read(_FOOTER.size) if place > 0 else b""
        footer = _FOOTER.unpack(tail) if len(tail) == _FOOTER.size else (0, 0, 0, 0, 0)
        opcode, _, start, _, checksum = footer
        content = b""
        if opcode == Opcode.FOOTER and 0 <= place - start <= LARGEST:
            file.seek(start)
            content = file.read(place - start)
        found = zlib.crc32(tail[:-4], zlib.crc32(content))
        if not content or checksum not in (0, found):
            self.problems.append(
                f"{self.path.name} has no whole index: cut off or damaged; run: session recover"
            )
            return
        for record in _records(BytesIO(content), 0, len(content), _DECLARATIONS):
            self._declare(record)

    def _declare(self, record: Any) -> None:
        if isinstance(record, Schema):
            self._schemas[record.id] = record
        elif isinstance(record, Channel) and record.schema_id in self._schemas:
            schema, told = self._schemas[record.schema_id], record.metadata
            text = schema.data.decode(errors="replace")
            self.topics[record.id] = Topic(
                record.topic,
                schema.name,
                Definition(schema.encoding, text, ""),
                told.get("topic_type_hash", ""),
                tuple(yaml.safe_load(told.get("offered_qos_profiles", "")) or ()),
            )


def _records(file: IO[bytes], position: int, end: int, kinds: Mapping[int, Any]) -> Iterator[Any]:
    """Yield the records of these kinds; a BagError for a damaged one, and where reading ends."""
    while position < end:
        file.seek(position)
        head = file.read(_HEAD.size)
        opcode, length = _HEAD.unpack(head) if len(head) == _HEAD.size else (0, 0)
        begin, position = position, position + _HEAD.size + length
        if position > end or not (opcode or length):  # a torn end may be zeros
            yield BagError(f"cut off or damaged from byte {begin} on")
            return
        kind = kinds.get(opcode)
        if kind is None:
            if opcode > Opcode.DATA_END:
                yield BagError(f"a record of no known kind at byte {begin}")
            continue
        try:
            if length > LARGEST:
                raise BagError(f"{length} bytes are too many for one record")
            record = kind.read(ReadDataStream(BytesIO(file.read(length))))
        except Exception as error:  # whatever a decoder stumbles over
            record = BagError(f"a record at byte {begin} is damaged: {error}")
        yield record


def _unpacked(chunk: Chunk) -> Iterator[Any]:
    """Yield the declarations and messages of a chunk, or a BagError if it is damaged."""
    try:
        size = chunk.uncompressed_size
        if chunk.compression == "zstd":
            size = max(size, zstandard.frame_content_size(chunk.data))
        if size > LARGEST:
            raise BagError(f"{size} bytes are too many for one")
        stream, length = get_chunk_data_stream(chunk, validate_crc=True)
        while stream.count < length:
            opcode, size = stream.read1(), stream.read8()
            if opcode == Opcode.MESSAGE:
                yield Message.read(stream, size)
            else:
                content = ReadDataStream(BytesIO(stream.read(size)))
                if opcode in _DECLARATIONS:
                    yield _DECLARATIONS[opcode].read(content)
    except Exception as error:  # whatever its decompression or a decoder stumbles over
        yield BagError(f"a chunk is damaged: {error}")
