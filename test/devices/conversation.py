# SPDX-License-Identifier: Apache-2.0
"""The language of conversations with devices: steps as lines of text, and what each must give.

A file has conversations, each a title `GIVEN...: what it shows` and indented steps. A step is the
name of a method, its arguments as words, and ` = ` what it must return, where that matters; * and ?
are those of file names. `; ` separates steps on a line, `N x ` repeats the line, `#` begins a
comment. Drivers: `drive.txt` and `talk.py`; the rig: `test/rig/conversations.txt`.
"""

from __future__ import annotations

import re
from ast import literal_eval
from collections.abc import Iterator
from fnmatch import fnmatchcase
from pathlib import Path


def conversations(file: Path) -> Iterator[tuple[list[str], str, list[str]]]:
    """Yield what is given, in words, the sentence and the steps of each conversation."""
    text = re.sub(r" *(#.*)?\n", "\n", file.read_text(encoding="utf-8"))
    for title, steps in re.findall(r"^(\w.*)\n((?: .*\n|\n)+)", text, re.MULTILINE):
        given, _, sentence = title.partition(": ")
        yield given.split(), sentence, [line.strip() for line in steps.split("\n") if line.strip()]


def value_of(text: str) -> object:
    """Return the number, tuple or text."""
    try:
        return literal_eval(text)
    except (SyntaxError, ValueError):
        return text


def values_of(settings: list[str]) -> dict[str, object]:
    """Return the values of `NAME=VALUE`."""
    return {name: value_of(value) for name, value in (each.split("=") for each in settings)}


def carry_out(talk: object, line: str) -> None:
    """Carry out the steps of a line, which are methods of `talk`."""
    times, _, steps = line.rpartition(" x ")
    for step in int(times or 1) * steps.split("; "):
        said, _, wanted = step.partition(" = ")
        verb, *words = said.split()
        answer = getattr(talk, verb)(*words)
        assert not wanted or fnmatchcase(answer, wanted), f"{step}: {answer}"
