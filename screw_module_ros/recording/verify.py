# SPDX-License-Identifier: Apache-2.0
"""Audits a bag: damage, missing messages and their places, altered metadata.

All messages are counted again; the recorder's counts and metadata.yaml must agree. Configuration,
parameters and calibration identities must match their hashes. The report names what cannot be
counted, so that the verdict states its coverage.
"""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

from .audit import Counts, TopicAudit, monotonic_of, sequence_of
from .bag import CLOSED, METADATA_FILE, REFUSED
from .catalogue import resolved
from .errors import BagBusyError, BagReadError
from .expected import TICKED, absent, layout_of, stride_of, wrong_rate
from .files import Source, check_at_rest, files_of
from .noted import Noted, own, read_noted
from .seal import PARAMETERS, Sections, broken, disowned
from .survey import Survey, chunks, survey

_SHOWN = 5  # gaps listed per topic
_END_S = 1.0  # longest accepted silence of a topic with ticks at an end of the bag


class Gap(NamedTuple):
    """A gap in the sequence: log time of the message before it [ns], number of missing ones."""

    log_time: int
    missing: int


class Report(NamedTuple):
    """Result of `verify`.

    topics: counts by topic name. gaps: the first ones per topic. problems: sentences, empty if the
    bag is complete. notes: metadata of the recorder (configuration and so on). remarks: sentences
    about what could not be checked.
    """

    topics: dict[str, Counts]
    gaps: dict[str, list[Gap]]
    problems: list[str]
    notes: dict[str, Any]
    remarks: Sequence[str] = ()

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
    """Data of one topic, collected during the scan of the files."""

    def __init__(self, type_name: str, definition: str):
        self.type = type_name
        self.where = layout_of(type_name, definition)
        self.audit = TopicAudit(self.where)
        self.numbered = False
        self.first = self.last = 0
        self.oldest = b""
        self.times = array("Q")
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
        """Return the difference of the ticks from the node's rate, empty if none or unknown."""
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
    """Audit the bag in `folder`. Raises BagReadError if it is not a bag of this recorder."""
    folder = Path(folder)
    tracks: dict[str, _Track] = {}
    problems: list[str] = []
    noted, unreadable = _noted(folder)
    inside: Sections | None = None
    files, busy = files_of(folder), ""
    for path in files:
        with Source(path) as source:
            busy = busy or _in_use(source)
            found = survey(source, bool(noted.state))
            _walk(source, found, noted, tracks)
        inside = own(found.metadata) if found.complete else None
        problems += () if busy else _damage(found, folder)
    if unreadable:
        problems.append(
            f"{METADATA_FILE} cannot be read ({unreadable}); run: session recover {folder}"
        )
    notes = noted.sections
    for topic in noted.topics:  # a file may lack the declaration of a topic without messages
        tracks.setdefault(topic.name, _Track(topic.type, ""))
    tracks = dict(sorted(tracks.items()))
    for name, track in tracks.items():
        track.audit.stride = stride_of(name, track.type, notes.get(PARAMETERS))
    counts = {name: track.audit.counts() for name, track in tracks.items()}
    counts = _with_noted(counts, noted)
    remarks = [*_uncounted(counts, tracks), *_ends(tracks), *_unexpected(tracks, notes)]
    counts = _with_numbers(counts, tracks)
    problems += [_missing(name, count) for name, count in counts.items() if not count.complete]
    problems += _suspect(tracks, notes)
    if busy:
        problems.append(f"{busy}: verify the bag when it is closed")
    elif not unreadable:
        problems += _unlisted(files, noted, folder)
        problems += _compared(counts, noted)
        problems += broken(notes, inside)
        problems += disowned(notes, {name: track.newest for name, track in tracks.items()})
    gaps = {name: list(islice(track.gaps(), _SHOWN)) for name, track in tracks.items()}
    gaps = {name: found for name, found in gaps.items() if found and counts[name].lost}
    return Report(counts, gaps, problems, notes, remarks)


def _noted(folder: Path) -> tuple[Noted, str]:
    """Return the content of metadata.yaml, and the reason if it cannot be read."""
    try:
        return read_noted(folder), ""
    except BagReadError as error:
        return Noted(), str(error)


def _in_use(source: Source) -> str:
    """Return that another process writes the file, empty if none does."""
    try:
        check_at_rest(source, 0.0)
    except BagBusyError as error:
        return str(error)
    return ""


def _walk(source: Source, found: Survey, noted: Noted, tracks: dict[str, _Track]) -> None:
    """Add the messages of one file to the tracks."""
    channels = resolved(found.channels, {}, noted.topics, sorted(found.counts))
    track_of = {
        number: tracks.setdefault(d.channel.topic, _Track(d.schema.name, d.text))
        for number, d in channels.items()
    }
    for chunk in chunks(source, found):
        for message in chunk.messages:
            track_of[message.channel].add(message.log_time, message.sequence, message.data)


def _damage(found: Survey, folder: Path) -> Iterator[str]:
    """Yield a sentence about the unreadable parts of a file."""
    way_out = f"run: session recover {folder}"
    name = found.path.name
    if found.orderly and not found.complete:
        yield f"{name} was cut off; {way_out}"
    elif not found.whole:
        lost = sum(damage.end - damage.start for damage in found.cut)
        where = f" from byte {found.cut[0].start} on" if found.cut else ""
        yield f"{name} is damaged: {lost} bytes cannot be read{where}; {way_out}"


def _with_noted(counts: dict[str, Counts], noted: Noted) -> dict[str, Counts]:
    """Add counts that only the recorder knows: unwritten messages, topics with two publishers."""
    found = {}
    for name, count in counts.items():
        counted = noted.audit(name)
        missed = -1 if counted.missed < 0 else count.missed
        found[name] = count._replace(dropped=counted.dropped, missed=missed)
    return found


def _with_numbers(counts: dict[str, Counts], tracks: dict[str, _Track]) -> dict[str, Counts]:
    """Mark the missed messages of topics without sequence numbers as unknown."""
    return {
        name: count._replace(missed=-1) if count.messages and not tracks[name].numbered else count
        for name, count in counts.items()
    }


def _uncounted(counts: dict[str, Counts], tracks: dict[str, _Track]) -> Iterator[str]:
    """Yield remarks about topics whose losses would not be visible."""
    for name, count in counts.items():
        if count.missed < 0:
            yield f"{name}: messages not received are not counted: several publishers"
        elif count.messages and not tracks[name].numbered:
            yield f"{name}: messages not received are not counted: they carry no number"
        track = tracks[name]
        if count.stride and not track.audit.stride:
            yield f"{name}: its stride of {count.stride} ticks is estimated from its messages"
    silent = [name for name, count in counts.items() if not count.messages]
    if silent:
        yield f"no message at all: {', '.join(silent)}"


def _ends(tracks: dict[str, _Track]) -> Iterator[str]:
    """Yield remarks about topics with ticks that begin late or end early, which leaves no gap."""
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
    """Yield problems that leave no gap: topics not recorded or silent, jumps, wrong rates."""
    for name, why in notes.get(REFUSED, {}).items():
        yield f"{name}: requested but not recorded: {why}"
    for name, track in tracks.items():
        if track.type not in TICKED:
            continue
        count = track.audit.counts()
        if not count.messages:
            yield f"{name}: subscribed to, but no message arrived"
        elif count.restarts:
            yield f"{name}: its sequence jumped {count.restarts} times, too far to count losses"
        elif why := track.wrong_rate(notes.get(PARAMETERS, {})):
            yield f"{name}: {why}"


def _unlisted(files: list[Path], noted: Noted, folder: Path) -> Iterator[str]:
    """Yield a sentence if metadata.yaml lists other files: readers open those that it lists."""
    names = tuple(path.name for path in files)
    if noted.files != names:
        listed = f"lists {', '.join(noted.files) or 'none'}, but there are {', '.join(names)}"
        yield f"{METADATA_FILE} {listed}; run: session recover {folder}"


def _compared(counts: dict[str, Counts], noted: Noted) -> Iterator[str]:
    if noted.state != CLOSED:
        yield f"the recording was not closed properly (state: {noted.state or None})"
    for line in noted.topics:
        found = counts[line.name].messages
        if line.messages != found:
            claim = f"{METADATA_FILE} states {line.messages} messages"
            yield f"{line.name}: {claim}, the files contain {found}"


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
