# SPDX-License-Identifier: Apache-2.0
"""Ways to damage a file of a bag: one record of it, or at random for `fuzz_bags`."""

from __future__ import annotations

import json
import os
import random
import struct
import time
import zlib
from collections.abc import Callable
from pathlib import Path

import zstandard
from bag_counts import intact_chunk

CHUNK, FILE = 6, "bag_0.mcap"
Damage = Callable[[random.Random, bytes], bytes]


def _somewhere(rng: random.Random, content: bytes) -> int:
    """Return a place: anywhere, or near an end where there is most to break."""
    if not content:
        return 0
    near = rng.choice((len(content), len(content), 200))
    place = rng.randrange(min(near, len(content)))
    return place if rng.random() < 0.7 else len(content) - 1 - place


def alter(folder: Path, change: Callable[[bytearray], None], name: str = FILE) -> bytes:
    """Change the bytes of a file in place; return what it was."""
    before = (folder / name).read_bytes()
    changed = bytearray(before)
    change(changed)
    (folder / name).write_bytes(changed)
    return before


def place_of(data: bytes, opcode: int, number: int) -> int:
    """Return where the given record of this kind begins."""
    position = 8
    while True:
        if data[position] == opcode:
            if number == 0:
                return position
            number -= 1
        position += 9 + int.from_bytes(data[position + 1 : position + 9], "little")


def old(folder: Path) -> None:
    """Make it look as if the last change of a bag was an hour ago."""
    past = time.time() - 3600
    for path in [*folder.iterdir(), folder]:
        os.utime(path, (past, past), follow_symlinks=False)


def truncated(rng: random.Random, content: bytes) -> bytes:
    return content[: _somewhere(rng, content)]


def flipped(rng: random.Random, content: bytes) -> bytes:
    changed = bytearray(content)
    if changed:
        changed[_somewhere(rng, content)] ^= 1 << rng.randrange(8)
    return bytes(changed)


def torn(rng: random.Random, content: bytes) -> bytes:
    """End a write half way: behind it stands the rest of the file's end that it was to replace."""
    chunks = _chunks(content)
    if not chunks:
        return truncated(rng, content)
    end = content[intact_chunk(content, chunks[-1])[0] :]
    start, written = rng.choice(chunks), rng.randrange(3000)
    return content[: start + written] + end[written:]


def flipped_and_truncated(rng: random.Random, content: bytes) -> bytes:
    return flipped(rng, content)[: max(0, len(content) - rng.randrange(1, 300))]


def scattered(rng: random.Random, content: bytes) -> bytes:
    for _ in range(rng.randrange(2, 40)):
        content = flipped(rng, content)
    return content


def blanked(rng: random.Random, content: bytes) -> bytes:
    start, length = _somewhere(rng, content), rng.choice((8, 512, 4096))
    filling = rng.choice((b"\0", b"\xff", b"\x06", rng.randbytes(1))) * length
    return (content[:start] + filling + content[start + length :])[: len(content)]


def removed(rng: random.Random, content: bytes) -> bytes:
    start = _somewhere(rng, content)
    return content[:start] + content[start + rng.choice((1, 7, 512, 4096)) :]


def inserted(rng: random.Random, content: bytes) -> bytes:
    start = _somewhere(rng, content)
    return content[:start] + rng.randbytes(rng.choice((1, 7, 512))) + content[start:]


def huge(rng: random.Random, content: bytes) -> bytes:
    """Declare an impossible length."""
    place = rng.choice([n for n, byte in enumerate(content) if byte in (1, 3, 4, 6, 7, 8, 12)])
    value = rng.choice((2**64 - 1, 2**63, 2**40, len(content) - place - 9))
    return content[: place + 1] + struct.pack("<Q", value) + content[place + 9 :]


def resealed(rng: random.Random, content: bytes) -> bytes:
    """Damage the records of a chunk, or the index, and make the checksum fit."""
    chunks = [
        n for n in range(len(content) - 49) if content[n] == 6 and intact_chunk(content, n)[0]
    ]
    if not chunks or rng.random() < 0.2:
        return _resealed_index(rng, content)
    place = rng.choice(chunks[:3] + chunks)
    end, _ = intact_chunk(content, place)
    head = list(struct.unpack_from("<BQQQQII", content, place))
    packed = content[place + 49 + head[6] : end]
    data = zstandard.decompress(packed, head[4]) if head[6] else packed
    data = rng.choice((flipped, scattered, removed, huge))(rng, data[:1500]) + data[1500:]
    new = zstandard.compress(data, 1) if head[6] else data
    head[1], head[4], head[5] = 40 + head[6] + len(new), len(data), zlib.crc32(data)
    name = b"zstd"[: head[6]]
    record = struct.pack("<BQQQQII", *head) + name + struct.pack("<Q", len(new)) + new
    return content[:place] + record + content[end:]


def _chunks(content: bytes) -> list[int]:
    places = range(len(content) - 49)
    return [n for n in places if content[n] == CHUNK and intact_chunk(content, n)[0]]


def _resealed_index(rng: random.Random, content: bytes) -> bytes:
    summary = struct.unpack_from("<Q", content, len(content) - 28)[0]
    if not 0 < summary < len(content) - 37:
        return flipped(rng, content)
    inner = flipped(rng, content[summary:-37])
    foot = content[-37:-12]
    crc = struct.pack("<I", zlib.crc32(inner + foot))
    return content[:summary] + inner + foot + crc + content[-8:]


_ODD = (
    "null", "[]", "{}", "-1", "1e400", "9" * 5000, ".nan", "2001-99-99", "true", "!!python/name:os",
    "*x", "&x [*x]", '"\\ud800"', '"{\\"a\\": 1}"', "[" * 3000, "'", "1" + "0" * 400,
)  # fmt: skip


def reworded(rng: random.Random, content: bytes) -> bytes:
    """Put an odd value in a line of a text."""
    lines = content.decode(errors="replace").split("\n")
    for _ in range(rng.randrange(1, 4)):
        number = rng.randrange(len(lines))
        key = lines[number].partition(":")[0]
        other = lines[rng.randrange(len(lines))]
        lines[number] = rng.choice((f"{key}: {rng.choice(_ODD)}", "", other))
    return "\n".join(lines).encode(errors="replace")


def renoted(rng: random.Random, content: bytes) -> bytes:
    """Put an odd value into the JSON of custom_data."""
    text = content.decode(errors="replace")
    odd = rng.choice(("null", "[]", "1e999", "9" * 400, '{"a": 1}', "true", '"\\ud800"', "-5"))
    values = [place for place in range(len(text)) if text.startswith('\\": ', place)]
    if not values:
        return content
    place = rng.choice(values) + 4
    end = min(text.find(mark, place) % 10**9 for mark in (",", "}"))
    return (text[:place] + json.dumps(odd)[1:-1] + text[end:]).encode(errors="replace")


PLAIN: tuple[Damage, ...] = (truncated, flipped, torn)  # what the acceptance speaks of
ROUGH: tuple[Damage, ...] = (flipped_and_truncated, scattered, blanked, removed, inserted, huge)
CRAFTED: tuple[Damage, ...] = (resealed,)
NOTES: tuple[Damage, ...] = (truncated, flipped, blanked, reworded, renoted)
