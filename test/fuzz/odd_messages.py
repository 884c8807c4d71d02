# SPDX-License-Identifier: Apache-2.0
"""ROS messages of random content: as the middleware wants them, but for their meaning."""

from __future__ import annotations

import importlib
import math
import random
import re
from typing import Any

FLOATS = (0.0, -0.0, 1.0, -1.0, 100.0, 1e-320, 1e308, -1e308, math.nan, math.inf, -math.inf)
TEXTS = (
    "", "x", "../x", "/etc/passwd", "~nosuchuser/x", "~", ".", "a/b/../../../c", "ü\n\t", "%s%n",
    "{}",    "nan", "x" * 10_000, "null", "[" * 500, "a: &a [*a]", "a b", "-", "--help", "*", "📏",
    "encoder",    "friction_map", "evaluation", "P-AAAA-0000", "free", "active", "drop",
)  # fmt: skip
_INTEGER = re.compile(r"(u?)int(\d+)")
_SEQUENCE = re.compile(r"sequence<(.+?)(?:, (\d+))?>")
_ARRAY = re.compile(r"(.+)\[(\d+)\]")
_LONGEST = 4


def filled(rng: random.Random, message: Any) -> Any:
    """Fill a message with odd values; some fields keep their defaults. Returns it."""
    for name, kind in message.get_fields_and_field_types().items():
        if rng.random() < 0.8:
            setattr(message, name, _value(rng, kind))
    return message


def _value(rng: random.Random, kind: str) -> Any:
    if found := _SEQUENCE.fullmatch(kind):
        most = min(int(found[2] or _LONGEST), _LONGEST)
        return [_value(rng, found[1]) for _ in range(rng.randrange(most + 1))]
    if found := _ARRAY.fullmatch(kind):
        return [_value(rng, found[1]) for _ in range(int(found[2]))]
    if found := _INTEGER.fullmatch(kind):
        return _integer(rng, bool(found[1]), int(found[2]))
    if kind == "double":
        return rng.choice((*FLOATS, rng.uniform(-1.0, 1.0), rng.gauss(0.0, 1e3)))
    if kind == "float":
        return rng.choice((0.0, 1.0, -1.0, math.nan, math.inf))
    if kind == "boolean":
        return rng.random() < 0.5
    if kind == "octet":
        return bytes([rng.randrange(256)])
    if kind.startswith("string"):
        return rng.choice(TEXTS)
    package, _, name = kind.partition("/")
    return filled(rng, getattr(importlib.import_module(f"{package}.msg"), name)())


def _integer(rng: random.Random, unsigned: bool, bits: int) -> int:
    low, high = (0, 2**bits - 1) if unsigned else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    return rng.choice((0, 1, min(5, high), min(77, high), low, high, rng.randint(low, high)))
