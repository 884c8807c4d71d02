# SPDX-License-Identifier: Apache-2.0
"""Ways to damage the content of a file, at random."""

from __future__ import annotations

import random
from collections.abc import Callable

Damage = Callable[[random.Random, bytes], bytes]


def _somewhere(rng: random.Random, content: bytes) -> int:
    """Return a place: anywhere, or near an end where there is most to break."""
    if not content:
        return 0
    near = rng.choice((len(content), len(content), 200))
    place = rng.randrange(min(near, len(content)))
    return place if rng.random() < 0.7 else len(content) - 1 - place


def truncated(rng: random.Random, content: bytes) -> bytes:
    return content[: _somewhere(rng, content)]


def flipped(rng: random.Random, content: bytes) -> bytes:
    changed = bytearray(content)
    if changed:
        changed[_somewhere(rng, content)] ^= 1 << rng.randrange(8)
    return bytes(changed)


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


BYTES: tuple[Damage, ...] = (truncated, flipped, scattered, blanked, removed, inserted)
NOTES: tuple[Damage, ...] = (truncated, flipped, blanked, reworded)
