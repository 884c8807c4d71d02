# SPDX-License-Identifier: Apache-2.0
"""What another reader, the mcap library, finds in a bag; nothing of the recorder's own is used."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path

from mcap.records import Message as Record
from mcap.stream_reader import StreamReader

START = 1_700_000_000_000_000_000
MS = 1_000_000
SECOND = 1_000_000_000


def ticks(bag: Path) -> list[int]:
    """Return the tick numbers in a bag's first file up to its first error; they follow a stamp."""
    content, found = (bag / f"{bag.name}_0.mcap").read_bytes(), []
    with contextlib.suppress(Exception):
        for record in StreamReader(io.BytesIO(content), validate_crcs=True).records:
            if isinstance(record, Record):
                found.append(int.from_bytes(record.data[12:16], "little"))
    return found
