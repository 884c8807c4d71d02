# SPDX-License-Identifier: Apache-2.0
"""Cells of the report's tables, for the page and for a terminal, and the sentences on misses."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from rich.table import Table

from ..results import Quantity
from .rows import Checked, Compared
from .study import Module

COMPARED_HEAD = ("experiment", "figure", "thesis", "ours", "difference", "verdict")
CHECKED_HEAD = ("quantity", "truth", "identified", "wanted", "verdict")
CLOSING_HEAD = ("module", "PD", "thesis's model", "identified", "ratio", "with feedback")


def compared_rows(rows: Iterable[Compared]) -> list[tuple[str, ...]]:
    """Return the cells of the table of the thesis's figures and ours."""
    cells = []
    for row in rows:
        p = row.published
        if row.ours is None:
            cells.append((p.experiment, p.where, _number(p.value), "no result", "", "missed"))
            continue
        verdict = "agrees" if row.agrees else "differs"
        cells.append(
            (
                f"{p.experiment}: {row.ours.text}",
                p.where,
                f"{_number(p.value)} {row.ours.unit}".strip(),
                value_text(row.ours),
                f"{row.difference:+.3g}",
                verdict,
            )
        )
    return cells


def checked_rows(rows: Iterable[Checked]) -> list[tuple[str, ...]]:
    """Return the cells of the table of hidden values and identified ones."""
    return [
        (
            f"{row.wanted.experiment}: {row.ours.text if row.ours else row.wanted.quantity}",
            "" if math.isnan(row.truth) else _number(row.truth),
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
        return f"{_number(value)} {quantity.unit}".strip()
    digits = max(0, 1 - math.floor(math.log10(spread)))
    if digits > 6 or abs(value) >= 1e5:
        return f"{_number(value)} ± {spread:.1g} {quantity.unit}".strip()
    return f"{value:.{digits}f} ± {spread:.{digits}f} {quantity.unit}".strip()


def module_name(module: Module) -> str:
    """Return what the tables call a module."""
    return "the thesis's" if module.seed is None else f"seed {module.seed}"


def _number(value: float) -> str:
    return f"{value:.6g}" if abs(value) < 10.0 and abs(value - 1.0) < 0.01 else f"{value:.4g}"


def misses_of(
    modules: Sequence[Module], rows: list[Compared], checks: list[tuple[Module, Checked]]
) -> Iterable[str]:
    """Yield a sentence for everything that is not as it should be."""
    for module in modules:
        for name, outcome in module.outcomes.items():
            if outcome.failure:
                yield f"{module_name(module)} module, {name}: {outcome.failure}"
    for module, row in checks:
        if not row.met and row.ours:
            truth = "" if math.isnan(row.truth) else f", truth {_number(row.truth)}"
            yield (
                f"{module_name(module)} module, {row.wanted.experiment}, {row.ours.text}: "
                f"{value_text(row.ours)}{truth}, wanted {row.limit_text}"
            )
    for row in rows:
        if row.ours and not row.agrees:
            p = row.published
            why = p.why or "no explanation is known"
            yield (
                f"{p.experiment}, {row.ours.text}: thesis {_number(p.value)}, ours "
                f"{value_text(row.ours)}: {why}"
            )
    for module in modules:
        result = module.result("compensation")
        if result and result.value("ratio") >= 1.0:
            yield f"{module_name(module)} module: identified is no better than default"


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
