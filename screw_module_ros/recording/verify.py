# SPDX-License-Identifier: Apache-2.0
"""Audits a bag. `complete` means:

1. the SHA-256 of each file is the one in metadata.yaml;
2. every chunk matches its checksum, index and counts agree;
3. every topic with ticks has each due number from first to last, begins and ends within 1 s of the
   recording, and is not silent; where the system clock was set, by the monotonic times in it;
4. the message numbers of every topic with one publisher are contiguous;
5. the recorder dropped nothing;
6. every topic of a node whose parameters are in the bag is there, and so is every topic that was
   asked for; each node told its parameters.

All messages are counted again. What cannot be counted is named, so that the verdict states its
coverage.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from .bag import (
    CLOSED,
    DROPPED,
    EARLY,
    HASHES,
    LIBRARY,
    METADATA_FILE,
    PREFIX,
    RECOVERED,
    STATE,
    Topic,
)
from .bag_files import files_of, readable
from .clock_settings import ClockSettings
from .counts import TICKED, Count, Counts, Gap
from .recorder import AUDIT, NO_ANSWER, PARAMETERS, REFUSED
from .records import File, decoded, noted

_END_S = 1.0  # longest accepted silence of a topic with ticks at an end of the recording
_SHOWN = 5
_KINDS = (
    "counted by ticks and message numbers",
    "counted by ticks",
    "counted by message numbers",
    "not counted",
    "without a message",
)


class Report(NamedTuple):
    """Result of `verify`.

    topics: counts by topic name. gaps: the first ones per topic. problems: sentences, empty if the
    bag is complete. remarks: sentences about what could not be checked. notes: of the recorder.
    losses: those problems that only say which messages are missing; `topics` counts them. duration:
    from the first to the last message [s], not counting what the system clock was set by.
    """

    topics: dict[str, Counts]
    gaps: dict[str, list[Gap]]
    problems: list[str]
    remarks: list[str]
    notes: dict[str, dict[str, str]]
    losses: Sequence[str] = ()
    duration: float = 0.0

    @property
    def complete(self) -> bool:
        """Whether the bag is undamaged and no loss is known."""
        return not self.problems

    @property
    def verdict(self) -> str:
        """The verdict with its coverage, in one sentence."""
        kinds = Counter(_counted_by(count) for count in self.topics.values())
        parts = ", ".join(f"{kinds[kind]} {kind}" for kind in _KINDS if kinds[kind])
        covered = f"{len(self.topics)} topics: {parts}" if parts else "no topics"
        return f"{'complete' if self.complete else 'NOT complete'}; {covered}"


def _counted_by(count: Counts) -> str:
    if not count.messages:
        return _KINDS[4]
    numbered = count.missed >= 0
    if count.stride:
        return _KINDS[0 if numbered else 1]
    return _KINDS[2 if numbered else 3]


class _Track(Count):
    """The messages of one topic; span: first and last log time [ns]; settings: of the clock."""

    def __init__(self, topic: Topic):
        super().__init__(topic)
        self.span = 0, 0
        self.settings = ClockSettings(self.after_header)

    def add(self, number: int, data: bytes, log_time: int) -> None:
        first, last = self.span if self.messages else (log_time, log_time)
        self.span = min(first, log_time), max(last, log_time)
        if self.ticked:
            self.settings.add(data, log_time)
        self.take(number, data, log_time)


def verify(bag: Path | str) -> Report:
    """Audit the bag in the folder `bag`. Raises BagError if it is none, or cannot be read."""
    files = [File(path) for path in files_of(bag)]
    tracks: dict[str, _Track] = {}
    problems: list[str] = []
    for file in files:
        problems += _walk(file, tracks)
    told, flaws = readable(bag)
    problems += flaws
    tracks = dict(sorted(tracks.items()))
    notes = noted(told, files)
    parameters = notes.get(PARAMETERS, {})
    audit = {topic: decoded(text) for topic, text in notes.get(AUDIT, {}).items()}
    counts = {}
    losses = []
    for name, track in tracks.items():
        track.dropped = _number(audit.get(name, {}), "dropped")
        track.several = _number(audit.get(name, {}), "missed") < 0
        counts[name] = track.result(parameters)
        if not counts[name].complete:
            problems.append(_missing(name, counts[name]))
            losses += [] if counts[name].out_of_order else problems[-1:]
        problems += _ticks(track)
    problems += _ends(tracks.values())
    custom = told.get("custom_data", {})
    problems += [*_closed(bag, told, files), *_stated(told, counts), *_absent(tracks, notes)]
    remarks = [*_settings(tracks.values()), *_unchecked(bag, told, files), *_uncounted(tracks)]
    if custom and PREFIX + HASHES not in custom:
        remarks.append("an older version recorded it, without a hash of its files")
    gaps = {name: track.gaps(parameters) for name, track in tracks.items() if counts[name].lost}
    counts = {
        name: count if tracks[name].numbered or not count.messages else count._replace(missed=-1)
        for name, count in counts.items()
    }
    return Report(counts, gaps, problems, remarks, notes, losses, _duration(tracks.values()))


def _number(values: Mapping[str, Any], name: str) -> int:
    """Return a whole number of the recorder's counts, 0 if it is another value or not there."""
    value = values.get(name)
    return value if isinstance(value, int) else 0


def _walk(file: File, tracks: dict[str, _Track]) -> Iterator[str]:
    """Count the messages of a file; yield what is wrong with it."""
    for topic, message in file.messages():
        track = tracks.get(topic.name) or tracks.setdefault(topic.name, _Track(topic))
        track.add(message.sequence, message.data, message.log_time)
    for topic in file.topics.values():
        tracks.setdefault(topic.name, _Track(topic))
    yield from file.problems
    if file.stated not in (None, file.read):
        yield f"{file.path.name} states {file.stated} messages and holds {file.read}"


def _closed(bag: Path | str, told: Mapping[str, Any], files: list[File]) -> Iterator[str]:
    """Yield problems with the way the bag was closed, and with the hashes of its files.

    What another program recorded has no such state: it is closed if its files have their ends.
    """
    custom = told.get("custom_data", {})
    state = custom.get(PREFIX + STATE)
    if state == EARLY:
        yield (
            "the recording ended early, for want of room on the disk: "
            f"{custom.get(PREFIX + DROPPED)} messages that were received are not in the bag"
        )
    elif state != CLOSED and not _is_foreign(bag, told, files):
        yield (
            f"the recording goes on or was not closed (state: {state or 'unfinished'}); if it has "
            f"ended, run: session recover {bag}"
            if state != RECOVERED
            else "the bag is a recovered copy: what was lost before is not known"
        )
    names, listed = [file.path.name for file in files], told.get("relative_file_paths", [])
    if custom and names != listed:
        yield f"{METADATA_FILE} lists {', '.join(listed)}, but there are {', '.join(names)}"
    hashes = decoded(custom.get(PREFIX + HASHES, "{}"))
    for file in files:
        wanted = hashes.get(file.path.name)
        if wanted and sha256_of(file.path) != wanted:
            yield f"{file.path.name} was altered or damaged: its SHA-256 differs"


def _is_foreign(bag: Path | str, told: Mapping[str, Any], files: list[File]) -> bool:
    """Return whether the bag cannot have our state: whole files of another, or one without it."""
    ours = PREFIX + STATE in told.get("custom_data", {})
    alone = Path(bag).is_file() or all(file.library != LIBRARY for file in files)
    return not ours and alone and all(file.whole for file in files)


def _unchecked(bag: Path | str, told: Mapping[str, Any], files: list[File]) -> Iterator[str]:
    if not _is_foreign(bag, told, files):
        return
    if not told:
        yield f"without {METADATA_FILE}: whether further files belong to it is not known"
    elif not told.get("custom_data"):
        yield "another program recorded it, without a hash of its files"


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file, hexadecimal. Raises OSError."""
    found = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(2**20):
            found.update(block)
    return found.hexdigest()


def _stated(told: Mapping[str, Any], counts: Mapping[str, Counts]) -> Iterator[str]:
    """Yield where the counts in metadata.yaml are not those of the files."""
    for name, stated in told.get("topics_with_message_count", {}).items():
        found = counts.get(name, Counts()).messages
        if stated != found:
            yield f"{name}: {METADATA_FILE} states {stated} messages, the files contain {found}"


def _ticks(track: _Track) -> Iterator[str]:
    """Yield what is wrong with a topic of the graph that has ticks, beside gaps."""
    name = track.topic.name
    if not track.ticked:
        return
    if not track.messages:
        yield f"{name}: subscribed to, but no message arrived"
        return
    if restarts := track.result({}).restarts:
        yield f"{name}: its sequence jumped {restarts} times, too far to count losses"


def _spans(tracks: Iterable[_Track]) -> dict[str, tuple[int, int]]:
    """Return the first and the last time of each topic with messages [ns].

    Where the system clock was set and moved the log times, the monotonic times of the topics that
    have them.
    """
    spoke = [each for each in tracks if each.messages]
    timed = [each for each in spoke if each.settings.moved_log_times]
    if timed:
        return {each.topic.name: each.settings.span for each in spoke if each.settings.span[0]}
    return {each.topic.name: each.span for each in spoke}


def _ends(tracks: Iterable[_Track]) -> Iterator[str]:
    """Yield topics with ticks that begin late or end early."""
    tracks = list(tracks)
    spans = _spans(tracks)
    for track in tracks:
        name = track.topic.name
        if not (track.ticked and name in spans):
            continue
        late = (spans[name][0] - min(first for first, _ in spans.values())) * 1e-9
        early = (max(last for _, last in spans.values()) - spans[name][1]) * 1e-9
        if max(late, early) > _END_S:
            ends = f"ends {early:.1f} s before it"
            yield f"{name}: begins {late:.1f} s after the recording and {ends}"


def _duration(tracks: Iterable[_Track]) -> float:
    """Return the time from the first to the last message [s]."""
    spans = _spans(tracks).values()
    if not spans:
        return 0.0
    return (max(last for _, last in spans) - min(first for first, _ in spans)) * 1e-9


def _settings(tracks: Iterable[_Track]) -> Iterator[str]:
    """Yield when the system clock was set, by the topic that shows most of it."""
    most = max((each.settings.steps for each in tracks), key=len, default=[])
    if most:
        shown = ", ".join(f"{step:+.1f} s" for step in most[:_SHOWN])
        more = f" and {len(most) - _SHOWN} times more" if len(most) > _SHOWN else ""
        yield (
            f"the system clock was set by {shown}{more} while it was recorded; order and duration "
            "are those of numbers and monotonic time"
        )


def _absent(tracks: Mapping[str, _Track], notes: Mapping[str, Any]) -> Iterator[str]:
    """Yield topics that should be there, and nodes whose settings are unknown."""
    nodes = notes.get(PARAMETERS, {})
    types = {track.topic.type for track in tracks.values()}
    for kind, ticked in TICKED.items():
        there = [node for node in nodes if node.rpartition("/")[2] == ticked.publisher]
        if there and kind not in types:
            yield f"{there[0]} was there, but no topic of type {kind} is in the bag"
    for name, why in notes.get(REFUSED, {}).items():
        yield f"{name}: requested but not recorded: {why}"
    for node, told in nodes.items():
        if told == NO_ANSWER:
            yield f"{node}: the node did not report its parameters"


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


def _uncounted(tracks: Mapping[str, _Track]) -> Iterator[str]:
    """Yield remarks about topics whose losses would not be visible."""
    for name, track in tracks.items():
        if track.several or (track.messages and not track.numbered):
            why = "several publishers" if track.several else "they carry no number"
            yield f"{name}: messages not received are not counted: {why}"
    silent = [name for name, track in tracks.items() if not track.messages]
    if silent:
        yield f"no message at all: {', '.join(silent)}"
