# SPDX-License-Identifier: Apache-2.0
"""Audits a bag against itself: is it whole, is anything missing, and where.

Everything is counted anew from the messages; the recorder's own counts and metadata.yaml must say
the same. What the recorder noted of configuration, parameters and calibration must fit its hashes.
What cannot be counted is named: a verdict covers no more than it says.
"""

from __future__ import annotations

import json
from array import array
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from mcap.records import Schema

from .audit import Counts, TopicAudit, layout, monotonic_of, sequence_of
from .bag import AUDIT, CLOSED, METADATA_FILE, PREFIX, REFUSED, STATE
from .errors import BagReadError
from .expected import TICKED, absent, stride_of, wrong_rate
from .recovery import files_of, mapped
from .scan import chunks, data_start, is_complete, metadata_records
from .seal import PARAMETERS, broken, disowned

_SHOWN = 5  # gaps told per topic
_END_S = 1.0  # a topic with ticks that is silent for longer at an end of the bag is named


class Gap(NamedTuple):
    """A place where messages are missing: log time before it [ns], how many."""

    log_time: int
    missing: int


class Report(NamedTuple):
    """What `verify` found.

    topics: counts by topic name. gaps: the first places per topic. problems: sentences, empty when
    the bag is complete. notes: what the recorder put into the bag (configuration and so on).
    remarks: sentences about what could not be judged.
    """

    topics: dict[str, Counts]
    gaps: dict[str, list[Gap]]
    problems: list[str]
    notes: dict[str, Any]
    remarks: Sequence[str] = ()

    @property
    def complete(self) -> bool:
        """Whether the bag is whole and nothing is known to be missing in it."""
        return not self.problems

    @property
    def verdict(self) -> str:
        """The verdict with what it covers, in one sentence."""
        kinds = Counter(_counted_by(count) for count in self.topics.values())
        told = ", ".join(f"{kinds[kind]} {kind}" for kind in _KINDS if kinds[kind])
        covered = f"{len(self.topics)} topics: {told}" if told else "no topics"
        return f"{'complete' if self.complete else 'NOT complete'}; {covered}"


_KINDS = (
    "counted by ticks and message numbers",
    "counted by ticks",
    "counted by message numbers",
    "not counted",
    "without a message",
)


def _counted_by(count: Counts) -> str:
    if not count.messages:
        return _KINDS[4]
    numbered = count.missed >= 0
    if count.stride:
        return _KINDS[0 if numbered else 1]
    return _KINDS[2 if numbered else 3]


class _Track:
    """What is gathered of one topic while walking through the files."""

    def __init__(self, type_name: str, definition: str):
        self.type = type_name
        self.where = layout(definition)
        self.audit = TopicAudit(self.where)
        self.numbered = False
        self.first = self.last = 0
        self.oldest = b""
        self.times = array("q")
        self.sequences = array("I")
        self.newest = b""

    def add(self, log_time: int, number: int, data: bytes) -> None:
        self.audit.update(data, number)
        self.numbered = self.numbered or number > 0
        self.first, self.last = self.first or log_time, log_time
        self.oldest = self.oldest or data
        self.newest = data
        if self.where:
            self.times.append(log_time)
            self.sequences.append(sequence_of(data, self.where))

    def wrong_rate(self, parameters: Mapping[str, str]) -> str:
        """Say how the ticks differ from the rate noted; empty when they fit or cannot be told."""
        if not self.where or not self.newest:
            return ""
        first, last = (monotonic_of(data, self.where) for data in (self.oldest, self.newest))
        ticks = self.sequences[-1] - self.sequences[0] & 0xFFFFFFFF
        return wrong_rate(self.type, ticks, (last - first) * 1e-9, parameters)

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
    information = _information(folder, problems)
    notes = _notes(information)
    for topic in _topics(information):  # a file does not tell of the last that never spoke
        tracks.setdefault(topic["name"], _Track(topic["type"], ""))
    tracks = dict(sorted(tracks.items()))
    for track in tracks.values():
        track.audit.stride = stride_of(track.type, notes.get(PARAMETERS))
    counts = {name: track.audit.counts() for name, track in tracks.items()}
    counts = _with_noted(counts, information)
    remarks = [*_uncounted(counts, tracks), *_ends(tracks), *_unexpected(tracks, notes)]
    counts = _with_numbers(counts, tracks)
    problems += _compared(counts, information)
    problems += [_missing(name, count) for name, count in counts.items() if not count.complete]
    problems += _suspect(tracks, notes)
    if information:
        problems += broken(notes, None if inside is None else _own(inside))
        problems += disowned(notes, {name: track.newest for name, track in tracks.items()})
    gaps = {name: list(_first(track.gaps())) for name, track in tracks.items()}
    return Report(counts, {n: g for n, g in gaps.items() if g}, problems, notes, remarks)


def _walk(buffer: memoryview, path: Path, tracks: dict[str, _Track]) -> int:
    """Take in one file; return where its data begins."""
    try:
        start = data_start(buffer)
    except BagReadError as error:
        raise BagReadError(f"{path}: {error}") from None
    schemas: dict[int, Schema] = {}
    channels: dict[int, _Track] = {}
    for found in chunks(buffer, start):
        schemas.update((schema.id, schema) for schema in found.schemas)
        for channel in found.channels:
            schema = schemas[channel.schema_id]
            track = tracks.setdefault(channel.topic, _Track(schema.name, schema.data.decode()))
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


def _topics(information: dict[str, Any]) -> list[dict[str, Any]]:
    lines = information.get("topics_with_message_count") or ()
    return [line["topic_metadata"] for line in lines]


def _with_noted(counts: dict[str, Counts], information: dict[str, Any]) -> dict[str, Counts]:
    """Add what only the recorder knew: messages it could not write, topics with two publishers."""
    audit = json.loads((information.get("custom_data") or {}).get(AUDIT, "{}"))
    found = {}
    for name, count in counts.items():
        noted = Counts(**audit.get(name, {}))
        missed = -1 if noted.missed < 0 else count.missed
        found[name] = count._replace(dropped=noted.dropped, missed=missed)
    return found


def _with_numbers(counts: dict[str, Counts], tracks: dict[str, _Track]) -> dict[str, Counts]:
    """Take back that nothing was missed where no message has a number to tell it by."""
    return {
        name: count._replace(missed=-1) if count.messages and not tracks[name].numbered else count
        for name, count in counts.items()
    }


def _uncounted(counts: dict[str, Counts], tracks: dict[str, _Track]) -> Iterator[str]:
    """Say of which topics a loss would not be seen."""
    for name, count in counts.items():
        if count.missed < 0:
            yield f"{name}: messages not received are not counted: several publishers"
        elif count.messages and not tracks[name].numbered:
            yield f"{name}: messages not received are not counted: they carry no number"
        track = tracks[name]
        if count.stride and not track.audit.stride:
            yield f"{name}: its stride of {count.stride} ticks is learned from its messages"
    silent = [name for name, count in counts.items() if not count.messages]
    if silent:
        yield f"no message at all: {', '.join(silent)}"


def _ends(tracks: dict[str, _Track]) -> Iterator[str]:
    """Say which topics with ticks do not last from end to end: no gap shows what is beyond."""
    spoke = {name: track for name, track in tracks.items() if track.newest}
    begin = min((track.first for track in spoke.values()), default=0)
    end = max((track.last for track in spoke.values()), default=0)
    for name, track in spoke.items():
        late, early = (track.first - begin) * 1e-9, (end - track.last) * 1e-9
        if track.type in TICKED and max(late, early) > _END_S:
            yield (
                f"{name}: begins {late:.1f} s after the recording and ends {early:.1f} s before it"
            )


def _unexpected(tracks: dict[str, _Track], notes: dict[str, Any]) -> Iterator[str]:
    return absent({track.type for track in tracks.values()}, notes.get(PARAMETERS, {}))


def _suspect(tracks: dict[str, _Track], notes: dict[str, Any]) -> Iterator[str]:
    """Say what does not fit the design or the recorder's notes, though no number is missing."""
    for name, why in notes.get(REFUSED, {}).items():
        yield f"{name}: was to be recorded and is not: {why}"
    for name, track in tracks.items():
        if track.type not in TICKED:
            continue
        count = track.audit.counts()
        if not count.messages:
            yield f"{name}: subscribed to, but no message came"
        elif count.restarts:
            yield f"{name}: its sequence jumped {count.restarts} times, over more than is counted"
        elif why := track.wrong_rate(notes.get(PARAMETERS, {})):
            yield f"{name}: {why}"


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
