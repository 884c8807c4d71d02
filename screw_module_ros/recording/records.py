# SPDX-License-Identifier: Apache-2.0
"""Messages, topics and notes of a bag's files in any state (`mcap_records` reads their records)."""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from io import BytesIO
from itertools import islice
from pathlib import Path
from typing import Any

import yaml
import zstandard
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from .bag import LIBRARY, PREFIX, BagError, Message, Topic
from .bag_files import ZSTD, files_of, information, opened
from .definitions import UNKNOWN, Definition
from .mcap_records import Content, indexed, records

LARGEST = 100 * 2**20
"""Largest record or uncompressed chunk that is read [B]: memory stays below ten times as much."""
_MAGIC = b"\x89MCAP0\r\n"
_FOOTER = struct.Struct("<BQQQI")  # opcode, length, start of the index and of its offsets, checksum
_DECLARATIONS = {Opcode.SCHEMA, Opcode.CHANNEL}
_INDEX = {Opcode.CHUNK_INDEX, Opcode.METADATA_INDEX, *_DECLARATIONS}
_NOTES = {Opcode.METADATA}
_DATA = {
    Opcode.HEADER, Opcode.CHUNK, Opcode.MESSAGE, Opcode.STATISTICS, *_DECLARATIONS, *_NOTES
}  # fmt: skip


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
    """One file in any state. Raises BagError if the disk cannot be read.

    topics: by channel; problems: sentences; library: that wrote it; stated, read: number of
    messages by its index, None without one, and of those in it: all are complete once `messages`
    has ended. whole: whether it has its end.
    """

    def __init__(self, path: Path):
        self.path = path
        self.topics: dict[int, Topic] = {}
        self.problems: list[str] = []
        self.library = ""
        self.stated: int | None = None
        self.read = 0
        self.whole = False
        self._schemas: dict[int, Schema] = {}
        self._undeclared: dict[int, list[Message]] = {}
        self._chunks: list[ChunkIndex] = []
        self._notes: list[int] = []

    def notes(self) -> dict[str, dict[str, str]]:
        """Return the recorder's notes in the readable part, by name; the last ones count."""
        with self._opened() as content:
            self._read_index(content)
            walk = partial(records, content, kinds=_NOTES, known=lambda channel: True)
            if self._is_indexed:
                found = [next(walk(begin=place), None) for place in self._notes]
            else:
                found = list(walk(begin=len(_MAGIC)))
            return {
                record.name.removeprefix(PREFIX): dict(record.metadata)
                for record in found
                if isinstance(record, Metadata) and record.name.startswith(PREFIX)
            }

    def messages(
        self, wanted: Callable[[Topic], bool] | None = None
    ) -> Iterator[tuple[Topic, Message]]:
        """Yield the messages of every whole record, those of one topic in the order of the file.

        wanted: whether to yield those of a topic, all by default.
        """
        with self._opened() as content:
            if content.at(0, len(_MAGIC)) != _MAGIC:
                self._problem("its first bytes are not those of MCAP")
            self._read_index(content)
            for found in records(content, len(_MAGIC), _DATA, self.topics.__contains__):
                if isinstance(found, Message):
                    self.read += 1
                    topic = self.topics.get(found.channel)
                    if topic is None:
                        self._undeclared.setdefault(found.channel, []).append(found)
                    elif wanted is None or wanted(topic):
                        yield topic, _plain(found)
                elif isinstance(found, Channel):
                    self._declare(found)
                    topic = self.topics.get(found.id)
                    held = self._undeclared.pop(found.id, []) if topic else []
                    if topic is not None and (wanted is None or wanted(topic)):
                        yield from ((topic, _plain(each)) for each in held)
                else:
                    self._take(found)
            if undeclared := sum(map(len, self._undeclared.values())):
                self.read -= undeclared
                self._problem(f"{undeclared} messages of topics whose declaration is damaged")

    def indexed(
        self, wanted: Callable[[Topic], bool] | None = None
    ) -> Iterator[tuple[Topic, Message]]:
        """Yield messages as `messages` does; the index tells where they are, if it is whole.

        Nothing else is read, so nothing else is found damaged, and no message is counted. Files of
        other recorders, whose index may leave something out, are read from end to end.
        """
        with self._opened() as content:
            self._read_index(content)
            if not self._is_indexed:
                yield from self.messages(wanted)
                return
            channels = {n for n, topic in self.topics.items() if wanted is None or wanted(topic)}
            for chunk in self._chunks:
                if named := channels & chunk.message_index_offsets.keys():
                    try:
                        for found in indexed(content, chunk, named):
                            yield self.topics[found.channel], _plain(found)
                    except BagError as error:
                        self._problem(str(error))

    @property
    def _is_indexed(self) -> bool:
        """Whether the index, which was read, names each message."""
        named = all(chunk.message_index_offsets for chunk in self._chunks)
        return self.whole and self.library == LIBRARY and bool(self._chunks) and named

    @contextmanager
    def _opened(self) -> Iterator[Content]:
        with opened(self.path) as (file, size, problem):
            if problem and f"{self.path.name}: {problem}" not in self.problems:
                self._problem(problem)
            file.seek(max(0, size - len(_MAGIC)))
            ends = size >= 2 * len(_MAGIC) and file.read() == _MAGIC
            yield Content(file, size - len(_MAGIC) if ends else size, LARGEST)

    def _problem(self, text: str) -> None:
        self.problems.append(f"{self.path.name}: {text}")

    def _take(self, found: Any) -> None:
        if isinstance(found, BagError):
            self._problem(str(found))
        elif isinstance(found, Statistics):
            self.stated = found.message_count
        elif isinstance(found, Header):
            self.library = found.library
        else:
            self._declare(found)

    def _read_index(self, content: Content) -> None:
        """Take the index with its declarations, which is whole by its checksum, or a problem.

        A file may have no index: its footer says so.
        """
        place = content.end - _FOOTER.size
        tail = content.at(place, _FOOTER.size) if place > 0 else b""
        footer = _FOOTER.unpack(tail) if len(tail) == _FOOTER.size else (0, 0, 0, 0, 0)
        opcode, length, start, _, checksum = footer
        self.whole = (opcode, length) == (Opcode.FOOTER, 20)
        index = b""
        if self.whole and 0 <= place - start <= LARGEST:
            index = content.at(start, place - start)
        if self.whole and not start:
            return
        found = zlib.crc32(tail[:-4], zlib.crc32(index))
        if not index or checksum not in (0, found):
            self.whole = False
            told = f"{self.path.name} has no whole index: cut off or damaged; run: session recover"
            self.problems += [] if told in self.problems else [told]
            return
        within = Content(BytesIO(index), len(index), LARGEST)
        self._chunks, self._notes = [], []
        for record in records(within, 0, _INDEX, lambda channel: False):
            if isinstance(record, ChunkIndex):
                content.chunks.add(record.chunk_start_offset)
                self._chunks.append(record)
            elif isinstance(record, MetadataIndex):
                self._notes.append(record.offset)
            else:
                self._declare(record)
        for record in islice(records(content, len(_MAGIC), {Opcode.HEADER}, bool), 1):
            self.library = getattr(record, "library", "")

    def _declare(self, record: Any) -> None:
        """Take a declaration; the first one of a channel counts, as a later one is the same."""
        if isinstance(record, Schema):
            self._schemas.setdefault(record.id, record)
        elif isinstance(record, Channel) and record.id not in self.topics:
            schema, told = self._schemas.get(record.schema_id), record.metadata
            if schema is None and record.schema_id:
                return
            text = schema.data.decode(errors="replace") if schema else ""
            self.topics[record.id] = Topic(
                record.topic,
                schema.name if schema else "",
                Definition(schema.encoding, text, "") if schema else UNKNOWN,
                told.get("topic_type_hash", ""),
                _offered(told.get("offered_qos_profiles", "")),
            )


def _offered(text: str) -> tuple[dict[str, Any], ...]:
    """Return the quality of service that a channel's metadata state, nothing for other content."""
    try:
        found = yaml.safe_load(text)
    except yaml.YAMLError:
        return ()
    listed = found if isinstance(found, list) else []
    return tuple(each for each in listed if isinstance(each, dict))


def _plain(message: Message) -> Message:
    """Return a message as it was published: rosbag2 can compress each one by itself.

    CDR begins with a zero, so that the content tells.
    """
    if not message.data.startswith(ZSTD):
        return message
    try:
        size = zstandard.frame_content_size(message.data)
        if not 0 <= size <= LARGEST:
            return message
        return message._replace(data=zstandard.decompress(message.data))
    except zstandard.ZstdError:
        return message


def chosen(names: Collection[str] | None) -> Callable[[Topic], bool]:
    """Return what `File.messages` wants of the topics `names`, of all for None."""
    return lambda topic: names is None or topic.name in names
