# SPDX-License-Identifier: Apache-2.0
"""Cells of the report's tables, for the page and for a terminal."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence

from rich.table import Table

from ...control import modes
from .. import robustness
from ..results import Quantity
from .rows import Checked, Compared
from .study import Module
from .words import like, number, scaled, value_text

_THESIS_SAYS = re.compile(r" \((?:thesis|appendix|Table|fig|[A-D0-9]\.)[^)]*\)$")

COMPARED_HEAD = (
    "experiment", "quantity", "figure", "thesis", "tolerance", "ours", "difference", "verdict",
)  # fmt: skip
CHECKED_HEAD = ("experiment", "quantity", "truth", "identified", "wanted", "verdict")
CLOSING_HEAD = ("module", "PD", "thesis's model", "identified", "ratio", "with feedback")


def compared_rows(rows: Iterable[Compared], brief: bool = False) -> list[tuple[str, ...]]:
    """Return the cells of the table of the thesis's figures and ours; brief: names, no texts."""
    cells = []
    for row in rows:
        p = row.published
        if row.ours is None:
            printed = (p.experiment, p.quantity, p.where, number(p.value))
            cells.append((*printed, number(p.near), "no result", "", row.verdict))
            continue
        cells.append(
            (
                p.experiment,
                _label(row.ours, brief),
                p.where,
                like(row.ours, p.value),
                f"± {number(p.near * scaled(row.ours.value, row.ours.unit)[0])}",
                value_text(row.ours),
                _difference(row),
                row.verdict,
            )
        )
    return cells


def checked_rows(rows: Iterable[Checked], brief: bool = False) -> list[tuple[str, ...]]:
    """Return the cells of the table of hidden values and identified ones."""
    return [
        (
            row.wanted.experiment,
            _label(row.ours, brief) if row.ours else row.wanted.quantity,
            _truth(row),
            value_text(row.ours) if row.ours else "no result",
            row.limit_text,
            "recovered" if row.met else "MISSED",
        )
        for row in rows
    ]


def closing_row(module: Module) -> tuple[str, ...] | None:
    """Return the offsets of feed-forward on a module with both models, None if not measured."""
    result = module.result("compensation")
    if result is None:
        return None
    names = (
        "offset_pd_default",
        "offset_feed_forward_default",
        "offset_feed_forward_identified",
        "ratio",
        "offset_combined_identified",
    )
    return (module_name(module), *(value_text(result.quantity(name)) for name in names))


def robustness_rows(modules: Iterable[Module]) -> list[tuple[str, ...]]:
    """Return the force error on every module without calibration, with it and on changed rigs."""
    rows = []
    for module in modules:
        result = module.result("robustness")
        if result is None:
            continue
        for mode in result.settings["modes"]:
            cells = [
                " / ".join(f"{rms:.2f}" for rms in robustness.rms_of(result, mode, case))
                for case in result.settings["cases"]
            ]
            rows.append((module_name(module), modes.MODE_NAMES[mode], *cells))
    return rows


def robustness_head(modules: Iterable[Module]) -> tuple[str, ...]:
    """Return the head of the robustness table, with the measured cases."""
    found = (module.result("robustness") for module in modules)
    cases = next((result.settings["cases"] for result in found if result), ())
    return ("module", "mode", *cases)


def module_name(module: Module) -> str:
    """Return a module's name in the tables."""
    return "the thesis's" if module.seed is None else f"seed {module.seed}"


def _label(quantity: Quantity, brief: bool) -> str:
    """Return a quantity's label, without the thesis's value, which has its own column."""
    if brief:
        return quantity.name
    return f"*{quantity.name}*: {_THESIS_SAYS.sub('', quantity.text)}"


def _difference(row: Compared) -> str:
    times, _ = scaled(row.ours.value, row.ours.unit)
    return f"{row.difference * times:+.3g}"


def _truth(row: Checked) -> str:
    if math.isnan(row.truth) or row.ours is None:
        return ""
    return like(row.ours, row.truth)


def markdown_table(title: str, head: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterable[str]:
    """Yield a Markdown table."""
    if title:
        yield f"## {title}"
        yield ""
    yield "| " + " | ".join(head) + " |"
    yield "|" + "---|" * len(head)
    for row in rows:
        yield "| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |"
    yield ""


def terminal_table(title: str, head: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    """Return a table for a terminal."""
    table = Table(title=title, title_justify="left")
    for name in head:
        table.add_column(name)
    for row in rows:
        table.add_row(*row)
    return table
