# SPDX-License-Identifier: Apache-2.0
"""Completes a bag whose recorder did not live to close it.

A killed recorder leaves a complete bag (see `mcap_file`); what is left to do then is to note it.
After a power failure the last write may be torn: everything up to the last whole chunk is kept, the
torn rest is cut off, and index, footer and metadata.yaml are written anew. Nothing is copied, so no
space is needed beyond the index.
"""

from __future__ import annotations

import json
import mmap
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

import yaml
from mcap.records import Channel

from .audit import Counts, TopicAudit, layout
from .bag import AUDIT, METADATA_FILE, PREFIX, RECOVERED, STATE, write_atomically
from .errors import BagError, BagReadError, BagWriteError
from .expected import stride_of
from .mcap_file import McapFile
from .metadata import FileLine, TopicLine, document, information
from .scan import ScannedChunk, chunks, data_start, is_complete
from .storage import StorageSettings


class Recovered(NamedTuple):
    """What `recover` did: files completed, messages now in the bag, bytes of torn tail cut off."""

    files: int
    messages: int
    cut: int

    def __str__(self) -> str:
        return (
            f"{self.messages} messages in the bag; {self.files} files completed, "
            f"{self.cut} bytes of a torn write cut off"
        )


class _Known(NamedTuple):
    """One topic as found in the files."""

    type: str
    audit: TopicAudit
    channel: Channel


def files_of(folder: Path) -> list[Path]:
    """Return the MCAP files of a bag in the order they were recorded.

    Raises BagReadError when there is none.
    """
    found = [path for path in folder.glob("*.mcap") if path.stem.rpartition("_")[2].isdigit()]
    if not found:
        raise BagReadError(f"{folder} is no bag folder: it holds no NAME_0.mcap")
    return sorted(found, key=lambda path: int(path.stem.rpartition("_")[2]))


def is_torn(folder: Path) -> bool:
    """Whether a bag needs `recover` before it can be read; cheap."""
    try:
        files = files_of(folder)
    except BagReadError:
        return False
    if not (folder / METADATA_FILE).exists():
        return True
    for path in files:
        with mapped(path) as buffer:
            if not is_complete(buffer):
                return True
    return False


@contextmanager
def mapped(path: Path) -> Iterator[memoryview]:
    """Give the content of a file as bytes without reading it all."""
    with path.open("rb") as file:
        if path.stat().st_size == 0:
            yield memoryview(b"")
            return
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            view = memoryview(content)
            try:
                yield view
            finally:
                view.release()


def recover_all(parent: Path) -> dict[Path, Recovered | BagError]:
    """Recover every torn bag right below `parent`; return what became of each."""
    found: dict[Path, Recovered | BagError] = {}
    for folder in sorted(path for path in parent.glob("*/") if is_torn(path)):
        try:
            found[folder] = recover(folder)
        except BagError as error:
            found[folder] = error
    return found


def recover(folder: Path | str) -> Recovered:
    """Complete the bag in `folder` in place and rewrite its metadata.yaml.

    Raises BagReadError when it is no bag of this recorder, BagBusyError when it is being recorded
    right now, BagWriteError when it cannot be written.
    """
    folder = Path(folder)
    topics: dict[str, _Known] = {}
    with ExitStack() as stack:
        try:
            files = [_opened(path, stack) for path in files_of(folder)]
            torn = [file for file in files if _restore(file, topics)]
            cut = sum(file.path.stat().st_size - file.data_end for file in torn)
            _write(folder, files, torn, topics)
        except OSError as error:
            raise BagWriteError(f"cannot recover {folder}: {error}") from None
        return Recovered(len(torn), sum(file.message_count for file in files), cut)


def _opened(path: Path, stack: ExitStack) -> McapFile:
    file = McapFile(path, StorageSettings(), create=False)
    stack.callback(file.close)
    return file


def _restore(file: McapFile, topics: dict[str, _Known]) -> bool:
    """Bring `file` to the state its last whole chunk left; return whether it must be completed."""
    with mapped(file.path) as buffer:
        try:
            file.data_end = data_start(buffer)
        except BagReadError as error:
            raise BagReadError(f"{file.path}: {error}") from None
        for found in chunks(buffer, file.data_end):
            _declare(file, found, topics)
            _count(file, found, topics)
            indexes = file.note_chunk(found.chunk, found.offset, found.index)
            file.data_end = found.end + len(indexes)
            if bytes(buffer[found.end : file.data_end]) != indexes:
                file.resume(found.end, indexes)
                break
        return not is_complete(buffer)


def _declare(file: McapFile, found: ScannedChunk, topics: dict[str, _Known]) -> None:
    for schema in found.schemas:
        file.schemas.append(schema)
    for channel in found.channels:
        file.channels.append(channel)
        file.counts.setdefault(channel.id, 0)
        schema = next(s for s in file.schemas if s.id == channel.schema_id)
        if channel.topic not in topics:
            audit = TopicAudit(layout(schema.data.decode()), stride_of(schema.name))
            topics[channel.topic] = _Known(schema.name, audit, channel)


def _count(file: McapFile, found: ScannedChunk, topics: dict[str, _Known]) -> None:
    audits = {channel.id: topics[channel.topic].audit for channel in file.channels}
    for message in found.messages:
        audits[message.channel].update(message.data, message.sequence)


def _write(
    folder: Path, files: list[McapFile], torn: list[McapFile], topics: dict[str, _Known]
) -> None:
    custom = _custom_data(folder)
    counts = _counts(topics, custom)
    custom[STATE] = RECOVERED
    custom[AUDIT] = json.dumps({name: count._asdict() for name, count in counts.items()})
    totals = dict.fromkeys(topics, 0)
    for file in files:
        for channel in file.channels:
            totals[channel.topic] += file.counts[channel.id]
    lines = [
        TopicLine(
            name,
            known.type,
            known.channel.metadata["topic_type_hash"],
            known.channel.metadata["offered_qos_profiles"],
            totals[name],
        )
        for name, known in topics.items()
    ]
    spans = [FileLine(f.path.name, f.start_time, f.end_time, f.message_count) for f in files]
    text = information(lines, spans, custom)
    for file in torn:
        file.metadata = {
            "rosbag2": {"serialized_metadata": text},
            AUDIT: {name: count.as_text() for name, count in counts.items()},
            **_records(custom),
        }
        file.flush()
    write_atomically(folder / METADATA_FILE, document(text))


def _counts(topics: dict[str, _Known], custom: dict[str, str]) -> dict[str, Counts]:
    """Count anew; what only the recorder knew is taken from its own last audit."""
    noted = json.loads(custom.get(AUDIT, "{}"))
    for name, known in topics.items():
        last = Counts(**noted.get(name, {}))
        known.audit.dropped = last.dropped
        known.audit.single_publisher = last.missed >= 0
    return {name: known.audit.counts() for name, known in topics.items()}


def _custom_data(folder: Path) -> dict[str, str]:
    """Return what metadata.yaml still tells; an unreadable one tells nothing."""
    try:
        content = yaml.safe_load((folder / METADATA_FILE).read_text(encoding="utf-8"))
        return dict(content["rosbag2_bagfile_information"]["custom_data"] or {})
    except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError, ValueError):
        return {}


def _records(custom: dict[str, str]) -> dict[str, dict[str, str]]:
    """Return the recorder's own entries of custom_data as MCAP metadata records."""
    found = {}
    for name, text in custom.items():
        if name.startswith(PREFIX) and name not in (STATE, AUDIT):
            found[name] = json.loads(text)
    return found
