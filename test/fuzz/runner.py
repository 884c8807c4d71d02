# SPDX-License-Identifier: Apache-2.0
"""Runs the cases of a fuzzer: each by its number, so that seed and number give it again."""

from __future__ import annotations

import contextlib
import random
import signal
import time
import traceback
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Protocol

LIMIT_S = 60  # wall clock; a case that takes longer hangs, on however busy a machine
LONGEST_SENTENCE = 700  # characters


class Target(Protocol):
    """What is fuzzed. counts: what came out, by kind."""

    counts: Counter[str]

    def case(self, rng: random.Random) -> None:
        """Carry out one case; an exception means that it failed."""

    def close(self) -> None:
        """Give back what it holds."""


class Hangs(Exception):
    """A case did not end."""


def run(target: Target, name: str, seed: int, numbers: Iterable[int], until: float) -> list[str]:
    """Run cases until `until` on time.monotonic() [s], or Ctrl-C; return the failures in words."""
    failures: list[str] = []
    for number in numbers:
        if time.monotonic() > until:
            break
        try:
            with _limited():
                target.case(random.Random(f"{seed} {name} {number}"))
        except KeyboardInterrupt:
            break
        except Exception:
            told = traceback.format_exc()
            failures.append(f"{name}, case {number} of seed {seed}:\n{told[-3000:]}")
            target.counts["FAILED"] += 1
        target.counts["cases"] += 1
    return failures


def sentence(error: BaseException | str) -> str:
    """Return what the user reads; fails when that is no sentence of bounded length."""
    told = str(error)
    assert told.strip(), f"{type(error).__name__} without a word"
    assert len(told) <= LONGEST_SENTENCE, f"{len(told)} characters: {told[:200]} ..."
    assert "Traceback" not in told
    return told


@contextlib.contextmanager
def _limited() -> Iterator[None]:
    def hangs(_number: int, _frame: object) -> None:
        raise Hangs(f"longer than {LIMIT_S} s")

    before = signal.signal(signal.SIGALRM, hangs)
    signal.alarm(LIMIT_S)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
