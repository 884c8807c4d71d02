# SPDX-License-Identifier: Apache-2.0
"""The hazards of docs/hazards.md, each with what shows that it is met.

A hazard is a heading of the third level with three items below it: cause, mitigation, and *Shown
by*, which names tests, rows and groups of the fault catalogue, and commands.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

PAGE = Path(__file__).resolve().parent.parent / "docs/hazards.md"
_ITEMS = ("Cause", "Mitigation", "Shown by")


class Hazard(NamedTuple):
    """A hazard: section of the page, name, and its items, each in one line; empty = not told."""

    section: str
    name: str
    cause: str
    mitigation: str
    shown_by: str

    @property
    def quoted(self) -> list[str]:
        """Return what stands in code among what shows it, each once."""
        return list(dict.fromkeys(re.findall(r"`([^`]+)`", self.shown_by)))

    @property
    def tests(self) -> list[str]:
        """Return the files, tests and conversations that show it, as `FILE` or `FILE::NAME`."""
        return [text for text in self.quoted if text.startswith("test/")]

    @property
    def commands(self) -> list[str]:
        """Return the commands of make that show it, which a person runs."""
        return [text for text in self.quoted if text.startswith("make ")]

    @property
    def rows(self) -> list[str]:
        """Return the rows of the fault catalogue that show it, as names or patterns."""
        return [text for text in self.quoted if not text.startswith(("test/", "make "))]

    @property
    def groups(self) -> list[str]:
        """Return the groups of the catalogue all of whose rows show it."""
        return re.findall(r"all of ([a-z ]+?)(?= *(?:[,;(]|$))", self.shown_by)


def hazards(text: str) -> list[Hazard]:
    """Return the hazards of the page."""
    found, section = [], ""
    for part in re.split(r"^(?=##)", text, flags=re.MULTILINE):
        heading, _, body = part.partition("\n")
        if heading.startswith("### "):
            items = [_item(name, body) for name in _ITEMS]
            found.append(Hazard(section, heading.removeprefix("### ").strip(), *items))
        else:
            section = heading.removeprefix("## ").strip()
    return found


def _item(name: str, body: str) -> str:
    item = re.search(rf"^- \*{name}\*:(.*(?:\n  .*)*)", body, re.MULTILINE)
    return " ".join(item[1].split()) if item else ""
