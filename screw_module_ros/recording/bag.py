# SPDX-License-Identifier: Apache-2.0
"""Writes a rosbag2 bag with the mcap library: a folder with MCAP files and metadata.yaml.

The format is that of `ros2 bag record -s mcap` of Jazzy. Each flush closes a chunk and brings it to
the disk, so that a kill or a power failure costs what came after the last flush. `close` writes
index, footer and metadata.yaml, which holds the SHA-256 of each file. A bag without metadata.yaml
is unfinished: `recover` makes a readable copy of it.

Errors name no path: a bag's name may be a patient's, and errors reach logs.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import yaml

from ..files import replace
from ..settings import Setting
from .definitions import Definition
from .mcap_file import FULL, NO_TIME, McapFile, Message

PREFIX = "screw_module_ros/"
"""Before the names of our entries in a bag's metadata."""
STATE, HASHES, DROPPED = "state", "sha256", "dropped"
CLOSED, RECOVERED, EARLY = "closed", "recovered", "ended early"
METADATA_FILE = "metadata.yaml"
LIBRARY = "screw_module_ros"
"""Our name in the header of a file."""
_VERSION = 9  # version of metadata.yaml in Jazzy
_MASK = 0xFFFFFFFF
_WAITS = "writing the bag waits for room on the disk: {}"


class BagError(Exception):
    """A bag cannot be written or read; the message says why and what to do."""


class BagExistsError(BagError):
    """A bag of this name exists: the recorder never overwrites."""


class BagFullError(BagError):
    """The disk has no room at present: what was written waits in memory, and can be tried again."""


class Topic(NamedTuple):
    """A recorded topic.

    name: full name. type: `package/msg/Type`. type_hash: RIHS01 hash that the publishers announce,
    empty for the definition's own. qos: what its publishers offer, in rosbag2's terms.
    """

    name: str
    type: str
    definition: Definition
    type_hash: str = ""
    qos: tuple[dict[str, Any], ...] = ()


class StorageSettings(NamedTuple):
    """Storage settings, like rosbag2's `zstd_fast`; changes apply to the next recording."""

    chunk_size: Annotated[
        int, Setting("uncompressed size at which a chunk is closed", "B", 1024, 2**26, live=True)
    ] = 786_432
    flush_period: Annotated[
        float, Setting("longest time until a message is on the disk", "s", 0.1, 1.0, live=True)
    ] = 0.8
    max_file_duration: Annotated[
        float,
        Setting(
            "duration after which a new file of the bag begins, 0 = never", "s", 0.0, live=True
        ),
    ] = 1800.0
    max_cache: Annotated[
        int,
        Setting(
            "memory for messages waiting for the disk; more are dropped and counted",
            "B",
            2**20,
            2**33,
            live=True,
        ),
    ] = 100 * 2**20
    min_free_space: Annotated[
        int,
        Setting("free disk space below which the file is closed; a new one begins at twice as much",
                "B", 0, 2**40, live=True),
    ] = 50 * 2**20  # fmt: skip


class Bag:
    """Writes one bag. Not thread-safe: `recorder.Recording` gives it a thread of its own.

    topics: by channel, from 1. message_count: on the disk. rests: between `rest` and `go_on`.
    """

    def __init__(self, folder: Path | str, settings: StorageSettings | None = None):
        """Create the bag's folder with its first file.

        Raises BagExistsError if `folder` exists, BagError if it cannot be made or written: then it
        leaves nothing behind.
        """
        self.folder = Path(folder)
        self.topics: list[Topic] = []
        self.message_count = 0
        self._settings = settings or StorageSettings()
        self._counts: list[int] = []
        self._files: list[McapFile] = []
        self._ended = False
        self.rests = self._is_to_rest = False
        _make_folder(self.folder)
        try:
            self._next_file()
        except BagError:
            for path in self.folder.iterdir():
                path.unlink()
            self.folder.rmdir()
            raise

    @property
    def written(self) -> int:
        """Number of messages, also of those that are not on the disk yet."""
        return sum(self._counts)

    @property
    def size(self) -> int:
        """Size of the file being written [B]."""
        return self._files[-1].size

    @property
    def held_reason(self) -> str:
        """Why the disk takes nothing at present, empty if it does."""
        return self._files[-1].held_reason

    def _next_file(self) -> None:
        self._make_file()
        self._bring(self._files[-1])

    def _make_file(self) -> None:
        with self._writing(waits=True):
            path = self.folder / f"{self.folder.name}_{len(self._files)}.mcap"
            self._files.append(McapFile(path, self._settings.chunk_size))
            self._files[-1].writer.start("ros2", LIBRARY)
            for topic in self.topics:
                self._declare(topic)
            self._files[-1].writer.flush()

    def _declare(self, topic: Topic) -> None:
        file, definition = self._files[-1], topic.definition
        key = topic.type, definition.text
        if key not in file.schemas:
            file.schemas[key] = file.writer.register_schema(
                topic.type, definition.encoding, definition.text.encode()
            )
        metadata = {
            "offered_qos_profiles": yaml.safe_dump(list(topic.qos), sort_keys=False),
            "topic_type_hash": topic.type_hash or definition.type_hash,
        }
        file.writer.register_channel(topic.name, "cdr", file.schemas[key], metadata)

    def add_topic(self, topic: Topic) -> int:
        """Add a topic; return its channel. Raises BagError."""
        self.topics.append(topic)
        self._counts.append(0)
        with self._writing():
            self._declare(topic)
        return len(self.topics)

    def note(self, name: str, values: dict[str, str]) -> None:
        """Store `values` under `name`; they replace earlier ones. Raises BagError."""
        with self._writing():
            self._files[-1].writer.add_metadata(PREFIX + name, values)

    def write(self, messages: Iterable[Message]) -> None:
        """Append messages; they are safe after the next `flush`. Raises BagError."""
        file = self._files[-1]
        with self._writing():
            for message in messages:
                channel, log_time, publish_time, sequence, data = message
                file.writer.add_message(channel, log_time, data, publish_time, sequence & _MASK)
                file.note_times(message)
                self._counts[channel - 1] += 1

    def flush(self) -> None:
        """Close the chunk and bring it to the disk: readable up to here, whatever happens.

        Raises BagFullError if the disk has no room, BagError if it fails: the file then ends with
        the last flush.
        """
        file = self._files[-1]
        if file.finished:  # there was no room for its index, or for what follows it
            if self._is_to_rest:
                self.rest()
            else:
                self._finish_file()
                self._next_file()
            return
        with self._writing():
            file.writer.flush()  # closes the chunk
        self._bring(file)
        self.message_count = self.written
        longest = self._settings.max_file_duration * 1e9
        if longest and file.messages and file.end - file.begin >= longest:
            self._finish_file()
            self._next_file()

    def _finish_file(self) -> None:
        file = self._files[-1]
        if not file.closed:
            with self._writing():
                file.finish()
            self._bring(file)
            file.close()

    def _bring(self, file: McapFile) -> None:
        """Bring what was written to the disk. Raises BagFullError, BagError."""
        with self._writing():
            if not file.flush():
                raise BagFullError(_WAITS.format(file.held_reason))

    def close(self, state: str = CLOSED) -> None:
        """Write index, footer and metadata.yaml; a second call does nothing.

        After a failed write, or on a full disk, the bag stays unfinished and ends with the last
        flush. Raises BagError if this fails.
        """
        if self._ended:
            return
        try:
            if not self.rests:
                self.rest(state)
        except BagFullError as error:
            self.cut_back()
            raise BagError(str(error)) from None
        self._ended = True

    def rest(self, state: str = CLOSED) -> None:
        """Make it a closed bag up to here, which `go_on` continues.

        Raises BagFullError, after which `flush` tries it again, or BagError.
        """
        self._is_to_rest = True
        self._finish_file()
        self.message_count = self.written
        with self._writing(waits=True):
            replace(self.folder / METADATA_FILE, self._metadata(state), private=True)
        self.rests = True

    def go_on(self) -> None:
        """Continue after `rest`, in a new file; without room for one it stays closed.

        Raises as `flush` does.
        """
        self._make_file()
        with self._writing():
            (self.folder / METADATA_FILE).unlink()  # it names the earlier files alone
        self.rests = self._is_to_rest = False
        self._bring(self._files[-1])

    def end_early(self, dropped: int) -> None:
        """End a bag at rest, of whose recording `dropped` messages are not in it.

        Where metadata.yaml cannot be written, the bag is left without one, as unfinished.
        """
        self._ended = True
        path = self.folder / METADATA_FILE
        try:
            replace(path, self._metadata(EARLY, {PREFIX + DROPPED: dropped}), private=True)
        except OSError:
            with suppress(OSError):
                path.unlink()

    @contextmanager
    def _writing(self, waits: bool = False) -> Iterator[None]:
        """Turn an OSError into a BagError and end the bag at its last flush.

        waits: for room on a full disk, which is a BagFullError and ends nothing.
        """
        if self._ended:
            raise BagError("the bag is closed")
        try:
            yield
        except OSError as error:
            if waits and error.errno in FULL:
                raise BagFullError(_WAITS.format(error.strerror)) from None
            self.cut_back()
            raise BagError(f"writing the bag failed: {error.strerror}") from None

    def cut_back(self) -> None:
        """End the bag at its last flush."""
        self._ended = True
        for file in self._files[-1:]:
            file.cut_back()
            file.close()

    def _metadata(self, state: str, more: Mapping[str, int] | None = None) -> str:
        filled = [file for file in self._files if file.messages]
        begin = min((file.begin for file in filled), default=NO_TIME)
        end = max((file.end for file in filled), default=NO_TIME)
        hashes = {file.path.name: file.sha256 for file in self._files}
        information = {
            "version": _VERSION,
            "storage_identifier": "mcap",
            "duration": {"nanoseconds": end - begin},
            "starting_time": {"nanoseconds_since_epoch": begin},
            "message_count": self.message_count,
            "topics_with_message_count": [
                {
                    "topic_metadata": {
                        "name": topic.name,
                        "type": topic.type,
                        "serialization_format": "cdr",
                        "offered_qos_profiles": list(topic.qos),
                        "type_description_hash": topic.type_hash or topic.definition.type_hash,
                    },
                    "message_count": count,
                }
                for topic, count in zip(self.topics, self._counts, strict=True)
            ],
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [file.path.name for file in self._files],
            "files": [file.as_yaml() for file in self._files],
            "custom_data": {
                PREFIX + STATE: state,
                PREFIX + HASHES: json.dumps(hashes),
                **{name: str(value) for name, value in (more or {}).items()},
            },
            "ros_distro": "jazzy",
        }
        return yaml.safe_dump({"rosbag2_bagfile_information": information}, sort_keys=False)


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(mode=0o700, parents=True)
    except FileExistsError:
        raise BagExistsError(
            "a bag of this name exists already and is never overwritten: choose another name or "
            "move it away"
        ) from None
    except OSError as error:
        raise BagError(f"cannot make the bag's folder: {error.strerror}") from None
