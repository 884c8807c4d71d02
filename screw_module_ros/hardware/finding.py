# SPDX-License-Identifier: Apache-2.0
"""One line of the table, and the table."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from typing import NamedTuple

OK, TO_DO, UNKNOWN = "ok", "TO DO", "?"
_WIDTH = 100


class Finding(NamedTuple):
    """What was looked at. todo: the way out, empty if all is well. known: it could be looked at."""

    what: str
    found: str
    wanted: str = ""
    todo: str = ""
    known: bool = True

    @property
    def verdict(self) -> str:
        """Return ok, TO DO, or ? for what could not be looked at."""
        if not self.known:
            return UNKNOWN
        return TO_DO if self.todo else OK


def table(findings: Iterable[Finding]) -> str:
    """Return the lines as text: verdict, what, found, wanted; below it what to do."""
    lines = []
    for each in findings:
        wanted = f" (wanted: {each.wanted})" if each.wanted and each.verdict != OK else ""
        text = f"{each.verdict:6} {each.what}: {each.found}{wanted}"
        lines += textwrap.wrap(text, _WIDTH, subsequent_indent=" " * 9) or [text]
        arrow = "-> "
        for part in each.todo.splitlines():
            lines += textwrap.wrap(
                f"{arrow}{part}", _WIDTH, initial_indent=" " * 7, subsequent_indent=" " * 10
            )
            arrow = " " * len(arrow)
    return "\n".join(lines)
