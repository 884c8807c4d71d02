# SPDX-License-Identifier: Apache-2.0
"""Writes a rosbag2 bag: folder, MCAP files, metadata.yaml, audit of the sequences.

The format is that of `ros2 bag record -s mcap` of Jazzy, plus the audit and the recorder's own
metadata. Both are stored twice: as MCAP metadata records and as JSON in the `custom_data` of
metadata.yaml, which survives a file torn by a power failure.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from .audit import Counts, TopicAudit
from .definitions import Definition
from .errors import BagExistsError, BagFolderError, BagWriteError
from .expected import layout_of, stride_of
from .files import write_atomically
from .mcap_file import McapFile, Message
from .metadata import FileLine, Qos, TopicLine, document, information, qos_yaml
from .seal import HASHES, sealed
from .storage import StorageSettings

PREFIX = "screw_module_ros/"
AUDIT = PREFIX + "audit"
STATE = PREFIX + "state"
REFUSED = "not recorded"  # section with the requested topics that are not recorded, and reasons
RECORDING, CLOSED, RECOVERED = "recording", "closed", "recovered"
METADATA_FILE = "metadata.yaml"


class Topic(NamedTuple):
    """A topic to record.

    name: full name. type: `package/msg/Type`. definition: see `definitions.Definitions`. type_hash:
    RIHS01 hash that the publishers announce, empty for the definition's own. qos: what its
    publishers offer.
    """

    name: str
    type: str
    definition: Definition
    type_hash: str = ""
    qos: Sequence[Qos] = ()


class BagWriter:
    """Writes one bag. Not thread-safe: `session.Session` gives it a thread of its own."""

    def __init__(self, folder: Path | str, settings: StorageSettings | None = None):
        """Create the bag's folder with an empty, complete bag in it.

        Raises BagExistsError if `folder` exists, BagFolderError if it cannot be made or written.
        """
        self.folder = Path(folder)
        self._settings = settings or StorageSettings()
        self._topics: list[Topic] = []
        self._hashes: list[str] = []
        self._qos: list[str] = []
        self._audits: list[TopicAudit] = []
        self._done: list[FileLine] = []
        self._done_counts: list[int] = []
        self._values: dict[str, dict[str, str]] = {}
        self._state = RECORDING
        self._broken = self._closed = False
        _make_folder(self.folder)
        try:
            self._file = self._next_file()
        except OSError as error:
            raise self._impossible(error.strerror) from None
        try:
            self.flush()
        except BagWriteError as error:
            self._file.close()
            raise self._impossible(str(error)) from None

    def _impossible(self, why: str) -> BagFolderError:
        """Remove the folder of a bag that could not be started; return the error to raise."""
        for path in self.folder.glob("*"):
            path.unlink()
        self.folder.rmdir()
        return BagFolderError(f"cannot write a bag to {self.folder}: {why}")

    def _next_file(self) -> McapFile:
        name = f"{self.folder.name}_{len(self._done)}.mcap"
        file = McapFile(self.folder / name, self._settings)
        for number in range(len(self._topics)):
            self._declare(file, number)
        return file

    def _declare(self, file: McapFile, number: int) -> int:
        topic = self._topics[number]
        known = {schema.name: schema.id for schema in file.schemas}
        schema = known.get(topic.type) or file.add_schema(
            topic.type, topic.definition.encoding, topic.definition.text
        )
        metadata = {
            "offered_qos_profiles": self._qos[number],
            "topic_type_hash": self._hashes[number],
        }
        return file.add_channel(topic.name, schema, metadata)

    def add_topic(self, topic: Topic) -> int:
        """Add a topic; return its channel."""
        self._topics.append(topic)
        self._hashes.append(topic.type_hash or topic.definition.type_hash)
        self._qos.append(qos_yaml(topic.qos))
        stride = stride_of(topic.name, topic.type)
        self._audits.append(TopicAudit(layout_of(topic.type, topic.definition.text), stride))
        self._done_counts.append(0)
        return self._declare(self._file, len(self._topics) - 1)

    def add_metadata(self, name: str, values: dict[str, str]) -> None:
        """Store `values` in the bag under `name`; they replace earlier ones.

        Each value is stored with its hash, see `seal`.
        """
        self._values[PREFIX + name] = dict(values)
        sections = {key.removeprefix(PREFIX): kept for key, kept in self._values.items()}
        self._values[PREFIX + HASHES] = sealed(sections)

    def write(self, messages: Iterable[Message]) -> None:
        """Append messages, oldest first. Raises BagWriteError if writing fails."""
        audits = self._audits
        kept = list(messages)
        for message in kept:
            audits[message[0] - 1].update(message[4], message[3])
        try:
            self._file.extend(kept)
        except OSError as error:
            raise self._failure(error) from None

    def dropped(self, channel: int, number: int) -> None:
        """Set the total number of received messages of a topic that were not written."""
        self._audits[channel - 1].dropped = number

    def several_publishers(self, channel: int) -> None:
        """Note that a topic has several publishers, with separate message numbers."""
        self._audits[channel - 1].single_publisher = False

    def flush(self) -> None:
        """Write all messages so far and metadata.yaml to the disk.

        Raises BagWriteError on failure; the bag then has the state of the previous flush.
        """
        try:
            self._file.close_chunk()
            text = self._information()
            self._file.metadata = {
                "rosbag2": {"serialized_metadata": text},
                AUDIT: {name: counts.as_text() for name, counts in self.audit().items()},
                **self._values,
            }
            self._file.flush()
            write_atomically(self.folder / METADATA_FILE, document(text))
        except OSError as error:
            raise self._failure(error) from None
        self._split_when_long()

    def _failure(self, error: OSError) -> BagWriteError:
        self._broken = True
        lost = sum(audit.messages for audit in self._audits) - self.message_count
        where = error.filename or self._file.path
        text = f"{where}: {error.strerror}"
        if lost:
            text += f"; the last {lost} messages are not in the bag, all earlier ones are"
        return BagWriteError(text)

    def _split_when_long(self) -> None:
        limit = int(self._settings.max_file_duration * 1e9)
        file = self._file
        if not limit or self._state != RECORDING or file.end_time - file.start_time < limit:
            return
        self._done.append(_line(file))
        for channel, count in file.counts.items():
            self._done_counts[channel - 1] += count
        file.close()
        try:
            self._file = self._next_file()
        except OSError as error:
            raise self._failure(error) from None
        self.flush()

    def close(self, state: str = CLOSED) -> None:
        """Flush, mark the bag as closed, and close it; a second call does nothing.

        Raises BagWriteError if the last flush fails; after a failed write it only closes the file.
        """
        if self._closed:
            return
        self._closed, self._state = True, state
        try:
            if not self._broken:
                self.flush()
        finally:
            self._file.close()

    def audit(self) -> dict[str, Counts]:
        """Return the counts of each topic."""
        return {t.name: a.counts() for t, a in zip(self._topics, self._audits, strict=True)}

    @property
    def size(self) -> int:
        """Size of the file being written [B]."""
        return self._file.size

    @property
    def message_count(self) -> int:
        """Number of messages on the disk."""
        return self._file.saved + sum(self._done_counts)

    def _information(self) -> str:
        topics = [
            TopicLine(
                topic.name,
                topic.type,
                self._hashes[number],
                self._qos[number],
                self._done_counts[number] + self._file.counts.get(number + 1, 0),
            )
            for number, topic in enumerate(self._topics)
        ]
        custom = {STATE: self._state}
        custom[AUDIT] = json.dumps({name: c._asdict() for name, c in self.audit().items()})
        for name, values in self._values.items():
            custom[name] = json.dumps(values)
        return information(topics, [*self._done, _line(self._file)], custom)


def _line(file: McapFile) -> FileLine:
    return FileLine(file.path.name, file.start_time, file.end_time, file.message_count)


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        raise BagExistsError(
            f"{folder} exists already and is never overwritten: choose another name or move it away"
        ) from None
    except OSError as error:
        raise BagFolderError(f"cannot make the bag folder {folder}: {error.strerror}") from None
