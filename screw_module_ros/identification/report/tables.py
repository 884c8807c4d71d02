# SPDX-License-Identifier: Apache-2.0
"""Cells of the report's tables, for the page and for a terminal."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence

from rich.table import Table

from ..results import Quantity
from .rows import Checked, Compared
from .study import Module

_THESIS_SAYS = re.compile(r" \((?:thesis|appendix|Table|fig|[A-D0-9]\.)[^)]*\)$")

COMPARED_HEAD = ("experiment", "figure", "thesis", "ours", "difference", "verdict")
CHECKED_HEAD = ("quantity", "truth", "identified", "wanted", "verdict")
CLOSING_HEAD = ("module", "PD", "thesis's model", "identified", "ratio", "with feedback")


def compared_rows(rows: Iterable[Compared], brief: bool = False) -> list[tuple[str, ...]]:
    """Return the cells of the table of the thesis's figures and ours; brief: names for texts."""
    cells = []
    for row in rows:
        p = row.published
        if row.ours is None:
            cells.append((p.experiment, p.where, number(p.value), "no result", "", "missed"))
            continue
        verdict = "agrees" if row.agrees else "differs"
        cells.append(
            (
                _label(p.experiment, row.ours, brief),
                p.where,
                f"{number(p.value)} {row.ours.unit}".strip(),
                value_text(row.ours),
                f"{row.difference:+.3g}",
                verdict,
            )
        )
    return cells


def checked_rows(rows: Iterable[Checked], brief: bool = False) -> list[tuple[str, ...]]:
    """Return the cells of the table of hidden values and identified ones."""
    return [
        (
            _label(row.wanted.experiment, row.ours, brief)
            if row.ours
            else f"{row.wanted.experiment}: {row.wanted.quantity}",
            "" if math.isnan(row.truth) else number(row.truth),
            value_text(row.ours) if row.ours else "no result",
            row.limit_text,
            "recovered" if row.met else "MISSED",
        )
        for row in rows
    ]


def closing_row(module: Module) -> tuple[str, ...] | None:
    """Return what feed-forward gives on a module with either model, None when not measured."""
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


def value_text(quantity: Quantity) -> str:
    """Return value, uncertainty and unit as people write them."""
    value, spread = quantity.value, quantity.uncertainty
    if math.isnan(spread) or spread <= 0.0 or not math.isfinite(value):
        return f"{number(value)} {quantity.unit}".strip()
    digits = max(0, 1 - math.floor(math.log10(spread)))
    if digits > 6 or abs(value) >= 1e5:
        return f"{number(value)} ± {spread:.1g} {quantity.unit}".strip()
    return f"{value:.{digits}f} ± {spread:.{digits}f} {quantity.unit}".strip()


def module_name(module: Module) -> str:
    """Return what the tables call a module."""
    return "the thesis's" if module.seed is None else f"seed {module.seed}"


def number(value: float) -> str:
    """Return a value with as many digits as a table needs."""
    return f"{value:.6g}" if abs(value) < 10.0 and abs(value - 1.0) < 0.01 else f"{value:.4g}"


def _label(experiment: str, quantity: Quantity, brief: bool) -> str:
    """Return what a table calls a quantity; what the thesis says has a column of its own."""
    if brief:
        return f"{experiment} {quantity.name}"
    return f"{experiment}: {_THESIS_SAYS.sub('', quantity.text)}"


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
