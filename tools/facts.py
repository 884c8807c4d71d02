# SPDX-License-Identifier: Apache-2.0
"""Compare params/thesis.yaml with a list of facts and with the text that these quote.

    tools/run python tools/facts.py FACTS TEXT

FACTS: YAML, by key: value, unit, where (section), quote, and the line of TEXT that has the quote.
Each difference is a sentence; the code is 1 when there is one. Neither file belongs to the
repository: quotes are somebody else's sentences. Without arguments only the repository's own file
is read.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Mapping
from typing import Any

from screw_module_ros.settings import SettingError
from screw_module_ros.settings_file import load, read_text
from screw_module_ros.thesis import FACTS_FILE, Fact, facts, unit_of

_SAME = 1e-9  # relative difference of equal numbers


def differences(ours: Mapping[str, Fact], theirs: Any, text: str) -> Iterator[str]:
    """Yield a sentence for each difference.

    ours: the repository's figures; theirs: the other list, as read; text: what its quotes are from.
    """
    if not isinstance(theirs, Mapping):
        yield "the list of facts is no mapping of keys to facts"
        return
    for key in ours:
        if key not in theirs:
            yield f"{key} is in {FACTS_FILE} alone"
    lines = text.splitlines()
    for key, other in theirs.items():
        if not isinstance(other, Mapping):
            yield f"{key} of the list of facts has no fields"
            continue
        if key not in ours:
            yield f"{key} is not in {FACTS_FILE}"
        else:
            yield from _of_one(key, ours[key], other)
        yield from _of_quote(key, other, lines)


def _of_one(key: str, own: Fact, other: Mapping[str, Any]) -> Iterator[str]:
    if not _equal(own.value, other.get("value")):
        yield f"{key}: value = {own.value!r} in {FACTS_FILE}, {other.get('value')!r} in the list"
    if unit_of(own.unit) != unit_of(str(other.get("unit"))):
        yield f"{key}: unit = {own.unit!r} in {FACTS_FILE}, {other.get('unit')!r} in the list"
    if own.where != other.get("where"):
        yield f"{key}: where = {own.where!r} in {FACTS_FILE}, {other.get('where')!r} in the list"


def _equal(own: Any, other: Any) -> bool:
    """Return whether two values are the same; YAML reads 6e-05, without a point, as text."""
    if isinstance(own, list) and isinstance(other, list):
        return len(own) == len(other) and all(map(_equal, own, other))
    if isinstance(own, (bool, str)) or isinstance(other, bool):
        return type(own) is type(other) and own == other
    try:
        return math.isclose(own, float(other), rel_tol=_SAME)
    except (TypeError, ValueError):
        return False


def _of_quote(key: str, other: Mapping[str, Any], lines: list[str]) -> Iterator[str]:
    quote, line = other.get("quote"), other.get("line")
    if not quote or not isinstance(quote, str):
        yield f"{key} of the list of facts has no quote"
        return
    found = [number for number, words in enumerate(lines, 1) if quote in words]
    if not found:
        yield f"{key}: the text has no {quote!r}"
    elif line is not None and line not in found:
        yield f"{key}: the text has {quote!r} in line {found[0]}, not in line {line}"


def main(arguments: list[str]) -> int:
    """Compare, print the differences; return 0 if there are none, 1 if there are, 2 for misuse."""
    try:
        ours = facts()
        if not arguments:
            print(f"{FACTS_FILE}: {len(ours)} figures. To compare them: tools/facts.py FACTS TEXT")
            return 0
        if len(arguments) != 2:
            print("usage: tools/facts.py FACTS TEXT", file=sys.stderr)
            return 2
        theirs, text = load(arguments[0]), read_text(arguments[1])
    except SettingError as error:
        print(error, file=sys.stderr)
        return 2
    found = list(differences(ours, theirs, text))
    print(*found or [f"{len(ours)} figures agree, and each quote is in the text."], sep="\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
