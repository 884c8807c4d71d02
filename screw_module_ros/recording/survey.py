# SPDX-License-Identifier: Apache-2.0
"""Surveys the readable and unreadable parts of one MCAP file without changing it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from mcap.records import Metadata

from .catalogue import Declarations, Gatherer
from .files import Source
from .mcap_file import HEAD
from .scan import (
    Damage,
    ScannedChunk,
    chunk_at,
    data_start,
    has_sound_head,
    outside,
    parts,
    summary_start,
)


class Survey(NamedTuple):
    """Content of one file.

    offsets: of its whole chunks [B]. cut: unreadable parts. counts: messages by channel.
    start_time, end_time: first and last log time [ns since the epoch], 0 without messages.
    channels: all declarations in it. metadata: its readable metadata records. orderly: whether the
    file is undamaged up to the last chunk. complete: whether the indexes of that chunk and the
    file's index exist and are undamaged.
    """

    path: Path
    offsets: list[int]
    cut: list[Damage]
    counts: dict[int, int]
    start_time: int
    end_time: int
    channels: Declarations
    metadata: dict[str, dict[str, str]]
    orderly: bool
    complete: bool

    @property
    def whole(self) -> bool:
        """Whether nothing needs repair."""
        return self.complete and self.orderly and not self.cut

    @property
    def messages(self) -> int:
        """Messages in its whole chunks."""
        return sum(self.counts.values())


def survey(source: Source, vouched: bool) -> Survey:
    """Scan a file. Raises BagReadError if another program wrote it.

    vouched: see `scan.has_sound_head`.
    """
    orderly = has_sound_head(source, vouched)
    indexed = True
    end = data_start(source)
    declared = Gatherer()
    offsets, cut, counts, times = [], [], Counter(), []
    for found in parts(source):
        if isinstance(found, Damage):
            cut.append(found)
            continue
        orderly = orderly and indexed and found.sound and not cut
        indexed = found.indexed
        offsets.append(found.offset)
        end = found.end
        declared.take(found.schemas, found.channels)
        counts.update({channel: len(entries) // 2 for channel, entries in found.index.items()})
        times += (found.chunk.message_start_time, found.chunk.message_end_time)
    # Declarations outside of chunks have no checksum, or only that of the index.
    spare = Gatherer()
    spare.take_outside(outside(source, len(HEAD)))
    spare.take_outside(outside(source, end))
    summary = summary_start(source)
    spare.take_outside(outside(source, summary) if summary > 0 else ())
    metadata = {
        found.record.name: found.record.metadata
        for found in outside(source, end)
        if isinstance(found.record, Metadata)
    }
    return Survey(
        source.path,
        offsets,
        cut,
        dict(counts),
        min(times, default=0),
        max(times, default=0),
        {**spare.found, **declared.found},
        metadata,
        orderly,
        indexed and summary > 0,
    )


def chunks(source: Source, found: Survey) -> Iterator[ScannedChunk]:
    """Yield the whole chunks of a surveyed file."""
    for offset in found.offsets:
        chunk = chunk_at(source, offset)
        if chunk is not None:
            yield chunk
