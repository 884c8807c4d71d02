# SPDX-License-Identifier: Apache-2.0
"""Completes a bag whose recorder ended without closing it, or that was damaged later.

A killed recorder leaves a complete bag (see `mcap_file`); recovery then only notes the state. After
a power failure the last write may be torn, and a disk may change a bit anywhere. Recovery keeps
every whole chunk, moves unreadable bytes to separate files, and writes index, footer and
metadata.yaml again. It removes a torn end in place, which needs space only for the index and the
torn end; it rewrites a file that is damaged before its end to a new file, which replaces the old.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

from .audit import Counts, TopicAudit
from .bag import AUDIT, CLOSED, METADATA_FILE, RECOVERED, STATE
from .catalogue import Declarations, resolved
from .errors import BagError, BagReadError, BagWriteError
from .expected import layout_of, stride_of
from .files import Source, check_at_rest, files_of, keep_beside, sync_folder, write_atomically
from .metadata import FileLine, TopicLine, document, information
from .noted import Noted, noted_from, parsed, read_noted
from .repair import Repair
from .scan import has_sound_head, summary_start
from .survey import Survey, chunks, survey

QUIET_S = 10.0  # a torn bag with a more recent change may still be being copied


class Recovered(NamedTuple):
    """Result of `recover`: repaired files, messages in the bag, bytes cut out, files with them."""

    files: int
    messages: int
    cut: int
    kept: tuple[Path, ...] = ()

    def __str__(self) -> str:
        done = {0: "no file needed repair", 1: "1 file completed"}
        text = f"{self.messages} messages in the bag; "
        text += done.get(self.files, f"{self.files} files completed")
        if self.cut:
            text += f", {self.cut} unreadable bytes cut out"
        if self.kept:
            text += "; kept beside: " + ", ".join(path.name for path in self.kept)
        return text


class _Part(NamedTuple):
    """One file of the bag."""

    source: Source
    survey: Survey
    channels: Declarations = {}


def is_torn(folder: Path) -> bool:
    """Whether a bag of this recorder needs `recover` before it can be read; a fast check.

    Raises BagReadError if its files cannot be read.
    """
    try:
        files = files_of(folder)
    except BagReadError:
        return False
    torn = not (folder / METADATA_FILE).exists()
    for path in files:
        with Source(path) as source:
            try:
                has_sound_head(source, vouched=False)
            except BagReadError:
                return bool(_noted(folder)[0].state)
            torn = torn or summary_start(source) < 0
    return torn


def recover_all(parent: Path) -> dict[Path, Recovered | BagError]:
    """Recover every torn bag directly below `parent`; return the result of each.

    It never raises: a damaged bag must not prevent further recordings.
    """
    found: dict[Path, Recovered | BagError] = {}
    for folder in _folders(parent):
        try:
            if is_torn(folder):
                found[folder] = recover(folder, QUIET_S)
        except BagError as error:
            found[folder] = error
        except Exception as error:  # nor must a defect of the recovery
            found[folder] = BagReadError(f"{type(error).__name__}: {str(error)[:80]}")
    return found


def _folders(parent: Path) -> list[Path]:
    """Return the folders directly below `parent`, without links, which lead elsewhere."""
    try:
        with os.scandir(parent) as entries:
            return sorted(Path(e.path) for e in entries if e.is_dir(follow_symlinks=False))
    except OSError:
        return []


def recover(folder: Path | str, quiet: float = 0.0) -> Recovered:
    """Complete the bag in `folder` and rewrite its metadata.yaml; keep a complete bag unchanged.

    quiet: least time since its last change [s]. Raises BagReadError if it is not a bag of this
    recorder, BagBusyError if it is being recorded or copied, BagWriteError if it cannot be written;
    the bag is then unchanged, or can be recovered again.
    """
    folder = Path(folder)
    try:
        with ExitStack() as stack:
            return _recover(folder, quiet, stack)
    except OSError as error:
        raise BagWriteError(f"cannot recover {folder}: {error.strerror or error}") from None


def _recover(folder: Path, quiet: float, stack: ExitStack) -> Recovered:
    noted, readable = _noted(folder)
    parts = [_looked_at(path, noted, quiet, stack) for path in files_of(folder)]
    if not readable:
        noted = _noted_inside(parts)
    parts = _with_channels(parts, noted)
    lines = _lines(parts, noted)
    surveys = [part.survey for part in parts]
    messages = sum(found.messages for found in surveys)
    ended = noted.state in (CLOSED, RECOVERED)
    ended = ended and all(found.whole for found in surveys) and _fits(noted, lines, surveys)
    if ended and readable:
        return Recovered(0, messages, 0)
    repairs = [
        None
        if part.survey.whole
        else stack.enter_context(Repair(part.source, part.survey, part.channels))
        for part in parts
    ]
    kept = [*_kept(parts), *_kept_metadata(folder)]
    custom = dict(noted.custom)
    if not ended:
        counts = _counted(parts, repairs, noted)
        custom[STATE] = RECOVERED
        custom[AUDIT] = json.dumps({name: count._asdict() for name, count in counts.items()})
    spans = tuple(FileLine(f.path.name, f.start_time, f.end_time, f.messages) for f in surveys)
    text = information(lines, spans, custom)
    for part, repair in zip(parts, repairs, strict=True):
        part.source.check_unchanged()
        if repair is not None:
            repair.finish(text, Noted(tuple(lines), (), custom))
    write_atomically(folder / METADATA_FILE, document(text))
    sync_folder(folder)
    cut = sum(damage.end - damage.start for found in surveys for damage in found.cut)
    return Recovered(sum(map(bool, repairs)), messages, cut, tuple(kept))


def _noted(folder: Path) -> tuple[Noted, bool]:
    """Return the content of metadata.yaml, and whether it can be read."""
    try:
        return read_noted(folder), True
    except BagReadError:
        return Noted(), False


def _looked_at(path: Path, noted: Noted, quiet: float, stack: ExitStack) -> _Part:
    if path.is_symlink():
        raise BagReadError(f"{path} is a link: recover the bag that it points to")
    source = stack.enter_context(Source(path))
    check_at_rest(source, quiet)
    return _Part(source, survey(source, bool(noted.state)))


def _noted_inside(parts: list[_Part]) -> Noted:
    """Return the metadata of the last readable file, in place of metadata.yaml."""
    for part in reversed(parts):
        text = part.survey.metadata.get("rosbag2", {}).get("serialized_metadata", "")
        try:
            return noted_from(parsed(text, part.source.path.name))
        except BagReadError:
            continue
    return Noted()


def _with_channels(parts: list[_Part], noted: Noted) -> list[_Part]:
    everywhere: Declarations = {}
    for part in parts:
        everywhere.update(part.survey.channels)
    return [
        part._replace(
            channels=resolved(
                part.survey.channels, everywhere, noted.topics, sorted(part.survey.counts)
            )
        )
        for part in parts
    ]


def _lines(parts: list[_Part], noted: Noted) -> list[TopicLine]:
    """Return every topic with the number of its messages, those of metadata.yaml first.

    A topic of metadata.yaml that no file declares is omitted: it has no message, and readers need
    its definition.
    """
    declared = {d.channel.topic for part in parts for d in part.channels.values()}
    lines = {line.name: line._replace(messages=0) for line in noted.topics}
    for part in parts:
        for number, (channel, schema) in sorted(part.channels.items()):
            metadata = channel.metadata
            line = lines.get(channel.topic) or TopicLine(
                channel.topic,
                schema.name,
                metadata.get("topic_type_hash", ""),
                metadata.get("offered_qos_profiles", "[]"),
                0,
            )
            count = line.messages + part.survey.counts.get(number, 0)
            lines[channel.topic] = line._replace(messages=count)
    return [line for name, line in lines.items() if name in declared]


def _fits(noted: Noted, lines: list[TopicLine], surveys: list[Survey]) -> bool:
    """Whether the counts in metadata.yaml match the files."""
    counts = {line.name: line.messages for line in noted.topics}
    names = tuple(found.path.name for found in surveys)
    return noted.files == names and counts == {line.name: line.messages for line in lines}


def _kept(parts: list[_Part]) -> Iterator[Path]:
    for part in parts:
        for start, end in part.survey.cut:
            name = f"{part.source.path.name}.cut_{start}_{end}"
            yield keep_beside(part.source, start, end, name)


def _kept_metadata(folder: Path) -> Iterator[Path]:
    """Copy metadata.yaml, whose counts show the content before the recovery."""
    path = folder / METADATA_FILE
    if path.exists():
        with Source(path) as old:
            yield keep_beside(old, 0, old.size, f"{METADATA_FILE}.before_recover")


def _counted(parts: list[_Part], repairs: list[Repair | None], noted: Noted) -> dict[str, Counts]:
    """Count all messages again, and pass the chunks to the repairs.

    Dropped messages and several publishers are known only from the recorder's last audit.
    """
    audits: dict[str, TopicAudit] = {}
    for part, repair in zip(parts, repairs, strict=True):
        own: dict[int, TopicAudit] = {}
        for number, declared in part.channels.items():
            name, kind = declared.channel.topic, declared.schema.name
            fresh = TopicAudit(layout_of(kind, declared.text), stride_of(name, kind))
            own[number] = audits.setdefault(name, fresh)
        for found in chunks(part.source, part.survey):
            for message in found.messages:
                own[message.channel].update(message.data, message.sequence)
            if repair is not None:
                repair.take(found)
    for name, audit in audits.items():
        last = noted.audit(name)
        audit.dropped = last.dropped
        audit.single_publisher = last.missed >= 0
    return {name: audit.counts() for name, audit in audits.items()}
