# SPDX-License-Identifier: Apache-2.0
"""Tables of the notebooks beside this file: our values, and the thesis's where it prints one."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

from IPython.display import Markdown

from screw_module_ros.thesis import fact, figure


class Row(NamedTuple):
    """A value of ours.

    key: of the thesis's figure in `params/thesis.yaml`, empty where it prints none; part: which
    number of a figure that is a list.
    """

    text: str
    value: float
    unit: str
    key: str = ""
    part: int | None = None


def beside(rows: Iterable[Row]) -> Markdown:
    """Return a table of values; the thesis's figures in the same unit, and where they stand.

    Raises SettingError for a key that there is not.
    """
    lines = ["| | here | thesis | difference | where |", "|---|---|---|---|---|"]
    for row in rows:
        here = _number(row.value, row.unit)
        if not row.key:
            lines.append(f"| {row.text} | {here} | | | |")
            continue
        printed = figure(row.key, row.part, row.unit)
        off = f"{100.0 * (row.value / printed - 1.0):+.1f} %"
        there = f"{_number(printed, row.unit)} | {off} | {fact(row.key).where}"
        lines.append(f"| {row.text} | {here} | {there} |")
    return Markdown("\n".join(lines))


def table(head: Iterable[str], rows: Iterable[Iterable[object]]) -> Markdown:
    """Return a table of cells; numbers with four digits."""
    head = list(head)
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for row in rows:
        cells = (_number(cell) if isinstance(cell, float) else str(cell) for cell in row)
        lines.append("| " + " | ".join(cells) + " |")
    return Markdown("\n".join(lines))


def _number(value: float, unit: str = "") -> str:
    if math.isnan(value):
        return ""
    if abs(value) >= 1e5:
        value, unit = value * 1e-6, f"M{unit}"
    text = f"{value:.0f}" if abs(value) >= 1e3 else f"{value:.4g}"
    return f"{text} {unit}".strip()
