# SPDX-License-Identifier: Apache-2.0
"""Audits a bag against itself: is it whole, is anything missing, and where.

Everything is counted anew from the messages; the recorder's own counts and metadata.yaml must say
the same. What the recorder noted of configuration, parameters and calibration must fit its hashes.
"""

from __future__ import annotations

import json
from array import array
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from .audit import Counts, TopicAudit, layout, sequence_of
from .bag import AUDIT, CLOSED, METADATA_FILE, PREFIX, STATE
from .errors import BagReadError
from .recovery import files_of, mapped
from .scan import chunks, data_start, is_complete, metadata_records
from .seal import broken, disowned

_SHOWN = 5  # gaps told per topic


class Gap(NamedTuple):
    """A place where messages are missing: log time before it [ns], how many."""

    log_time: int
    missing: int


class Report(NamedTuple):
    """What `verify` found.

    topics: counts by topic name. gaps: the first places per topic. problems: sentences, empty when
    the bag is complete. notes: what the recorder put into the bag (configuration and so on).
    """

    topics: dict[str, Counts]
    gaps: dict[str, list[Gap]]
    problems: list[str]
    notes: dict[str, Any]

    @property
    def complete(self) -> bool:
        """Whether the bag is whole and nothing is missing in it."""
        return not self.problems


class _Track:
    """What is gathered of one topic while walking through the files."""

    def __init__(self, definition: str):
        self.where = layout(definition)
        self.audit = TopicAudit(self.where)
        self.times = array("q")
        self.sequences = array("I")
        self.newest = b""

    def add(self, log_time: int, number: int, data: bytes) -> None:
        self.audit.update(data, number)
        self.newest = data
        if self.where:
            self.times.append(log_time)
            self.sequences.append(sequence_of(data, self.where))

    def gaps(self) -> Iterator[Gap]:
        stride = self.audit.counts().stride
        if not stride:
            return
        for number in range(1, len(self.sequences)):
            step = (self.sequences[number] - self.sequences[number - 1]) & 0xFFFFFFFF
            missing = (2 * step + stride) // (2 * stride) - 1
            if 0 < missing < 2**31 // stride:
                yield Gap(self.times[number - 1], missing)


def verify(folder: Path | str) -> Report:
    """Audit the bag in `folder`. Raises BagReadError when it is no bag of this recorder."""
    folder = Path(folder)
    tracks: dict[str, _Track] = {}
    problems: list[str] = []
    inside: dict[str, Any] | None = None
    for path in files_of(folder):
        with mapped(path) as buffer:
            start = _walk(buffer, path, tracks)
            inside = metadata_records(buffer, start) if is_complete(buffer) else None
            if inside is None:
                problems.append(f"{path.name} was cut off; run: session recover {folder}")
    counts = {name: track.audit.counts() for name, track in sorted(tracks.items())}
    information = _information(folder, problems)
    counts = _with_noted(counts, information)
    problems += _compared(counts, information)
    problems += [_missing(name, count) for name, count in counts.items() if not count.complete]
    notes = _notes(information)
    if information:
        problems += broken(notes, None if inside is None else _own(inside))
        problems += disowned(notes, {name: track.newest for name, track in tracks.items()})
    gaps = {name: list(_first(track.gaps())) for name, track in tracks.items()}
    return Report(counts, {n: g for n, g in gaps.items() if g}, problems, notes)


def _walk(buffer: memoryview, path: Path, tracks: dict[str, _Track]) -> int:
    """Take in one file; return where its data begins."""
    try:
        start = data_start(buffer)
    except BagReadError as error:
        raise BagReadError(f"{path}: {error}") from None
    schemas: dict[int, str] = {}
    channels: dict[int, _Track] = {}
    for found in chunks(buffer, start):
        schemas.update((schema.id, schema.data.decode()) for schema in found.schemas)
        for channel in found.channels:
            track = tracks.setdefault(channel.topic, _Track(schemas[channel.schema_id]))
            channels[channel.id] = track
        for message in found.messages:
            channels[message.channel].add(message.log_time, message.sequence, message.data)
    return start


def _information(folder: Path, problems: list[str]) -> dict[str, Any]:
    try:
        text = (folder / METADATA_FILE).read_text(encoding="utf-8")
        return yaml.safe_load(text)["rosbag2_bagfile_information"]
    except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError) as error:
        problems.append(f"{METADATA_FILE} cannot be read ({error}); run: session recover {folder}")
        return {}


def _with_noted(counts: dict[str, Counts], information: dict[str, Any]) -> dict[str, Counts]:
    """Add what only the recorder knew: messages it could not write, topics with two publishers."""
    audit = json.loads((information.get("custom_data") or {}).get(AUDIT, "{}"))
    found = {}
    for name, count in counts.items():
        noted = Counts(**audit.get(name, {}))
        missed = -1 if noted.missed < 0 else count.missed
        found[name] = count._replace(dropped=noted.dropped, missed=missed)
    return found


def _compared(counts: dict[str, Counts], information: dict[str, Any]) -> Iterator[str]:
    if not information:
        return
    state = (information.get("custom_data") or {}).get(STATE)
    if state != CLOSED:
        yield f"the recording was not closed in good order (state: {state})"
    for line in information["topics_with_message_count"]:
        name, noted = line["topic_metadata"]["name"], line["message_count"]
        found = counts[name].messages if name in counts else 0
        if noted != found:
            yield f"{name}: {METADATA_FILE} tells {noted} messages, the files hold {found}"


def _missing(name: str, count: Counts) -> str:
    parts = [
        f"{number} {word}"
        for word, number in (
            (f"lost in {count.gaps} gaps", count.lost),
            ("not received", count.missed),
            ("not written", count.dropped),
            ("out of order", count.out_of_order),
        )
        if number > 0
    ]
    return f"{name}: of {count.messages} messages " + ", ".join(parts)


def _first(gaps: Iterator[Gap]) -> Iterator[Gap]:
    for _, gap in zip(range(_SHOWN), gaps, strict=False):
        yield gap


def _notes(information: dict[str, Any]) -> dict[str, Any]:
    custom = _own(information.get("custom_data") or {})
    return {name: _values(text) for name, text in custom.items()}


def _values(text: Any) -> dict[str, str]:
    """Return one entry of custom_data; one that cannot be read is empty, and so found out."""
    try:
        return {str(key): str(value) for key, value in json.loads(text).items()}
    except (TypeError, ValueError, AttributeError):
        return {}


def _own(custom: dict[str, Any]) -> dict[str, Any]:
    """Return the recorder's own notes among `custom`, without their prefix."""
    return {
        key.removeprefix(PREFIX): value
        for key, value in custom.items()
        if key.startswith(PREFIX) and key not in (STATE, AUDIT)
    }
