# SPDX-License-Identifier: Apache-2.0
"""The report: one Markdown text, rendered to an HTML page, and tables for the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import NamedTuple

from rich.table import Table

from ..catalogue import EXPERIMENTS
from ..results import Result
from .drawings import draw
from .html import html_page
from .misses import Miss, misses_of
from .rows import Checked, Compared, checked, compared
from .study import Module
from .tables import (
    CHECKED_HEAD,
    CLOSING_HEAD,
    COMPARED_HEAD,
    checked_rows,
    closing_row,
    compared_rows,
    markdown_table,
    module_name,
    robustness_head,
    robustness_rows,
    terminal_table,
)
from .words import value_text

PAGE, TEXT = "report.html", "report.md"


class Report(NamedTuple):
    """What was written, and what it says. misses: what was wanted and is not there."""

    page: Path
    compared: list[Compared]
    checked: list[tuple[Module, Checked]]
    closing: list[tuple[str, ...]]
    changed: list[tuple[str, ...]]
    misses: list[Miss]

    def tables(self) -> list[Table | str]:
        """Return the tables for a terminal."""
        rows = compared_rows(self.compared, brief=True)
        thesis = terminal_table("Thesis and ours", COMPARED_HEAD, rows)
        truth = terminal_table(
            "Identified and hidden truth",
            ("module", *CHECKED_HEAD),
            [(module_name(m), *row) for m, c in self.checked for row in checked_rows([c], True)],
        )
        found: list[Table | str] = [thesis, truth]
        if self.closing:
            found.append(terminal_table("The loop closed", CLOSING_HEAD, self.closing))
        if self.changed:
            title = "rms [N]: not calibrated / calibrated / changed since"
            found.append(terminal_table(title, self.changed[0], self.changed[1:]))
        found.append("\n".join(f"missed: {miss.text}" for miss in self.misses) or "Nothing missed.")
        return found


def write_page(folder: Path, modules: Sequence[Module], seconds: float) -> Report:
    """Draw the figures and write report.md and report.html into the folder. Raises OSError."""
    thesis = modules[0]
    drawn = {}
    for name, outcome in thesis.outcomes.items():
        if outcome.result:
            drawn[name] = draw(name, outcome.result, folder / "figures")
    for module in modules[1:]:
        result = module.result("compensation")
        if result:
            title = f"seed_{module.seed}"
            drawn[title] = draw("compensation", result, folder / "figures", f"{title}-")
    rows = compared(thesis)
    checks = [(module, row) for module in modules for row in checked(module)]
    closing = [row for module in modules if (row := closing_row(module))]
    misses = list(misses_of(modules, rows, checks))
    text = "\n".join(_text(modules, rows, checks, closing, misses, drawn, seconds))
    (folder / TEXT).write_text(text, encoding="utf-8")
    page = folder / PAGE
    page.write_text(html_page(text), encoding="utf-8")
    changed = robustness_rows(modules)
    changed = [robustness_head(modules), *changed] if changed else []
    return Report(page, rows, checks, closing, changed, misses)


def _text(
    modules: Sequence[Module],
    rows: list[Compared],
    checks: list[tuple[Module, Checked]],
    closing: list[tuple[str, ...]],
    misses: list[Miss],
    drawn: dict[str, dict[str, str]],
    seconds: float,
) -> Iterable[str]:
    """Yield the lines of the Markdown report."""
    thesis = modules[0]
    met = sum(row.met for _, row in checks)
    verdicts = [row.verdict for row in rows]
    agree, loose = verdicts.count("agrees"), verdicts.count("compatible")
    yield "# The thesis's characterization, repeated"
    yield ""
    yield (
        "S. P. Buerger, *Characterization and Control of an Interactive Robot*, MIT 2001: every "
        "experiment of chapters 4 to 6 and appendices A, C and D, run in process on the simulated "
        f"module. Written {datetime.now(timezone.utc):%Y-%m-%d %H:%M} UTC by `make reproduce` in "
        f"{seconds:.0f} s; an experiment finished by an earlier, interrupted run is not repeated."
    )
    yield ""
    yield (
        f"- Of {len(rows)} published figures {agree} agree within the tolerance given for each; "
        f"{loose} more are compatible: within one that is wider than 30 % of the figure."
    )
    yield f"- {met} of {len(checks)} hidden values and marks were reached ({len(modules)} modules)."
    serious = sum(miss.serious for miss in misses)
    yield (
        f"- {len(misses)} misses, all under [Misses](#misses); {len(misses) - serious} of them are "
        "explained differences from the thesis."
    )
    seeds = ", ".join(str(module.seed) for module in modules[1:]) or "none"
    yield f"- Perturbed modules by seed: {seeds}. Noise: seed 1, or the module's own."
    yield ""
    yield from markdown_table("Thesis and ours", COMPARED_HEAD, compared_rows(rows))
    yield (
        "*agrees*: within what the thesis's own scatter, a figure read off a plot, or the plant's "
        "deliberate differences (stiction, Stribeck, backlash, noise) allow. *compatible*: the "
        "same, but the tolerance is wider than 30 % of the figure, so it shows little."
    )
    yield ""
    yield from markdown_table(
        "Identified and hidden truth",
        CHECKED_HEAD,
        checked_rows(row for module, row in checks if module is thesis),
    )
    yield (
        "The truth is read from the plant's parameters for this table alone; no experiment sees it."
    )
    yield ""
    for module in modules[1:]:
        mine = [row for other, row in checks if other is module]
        title = f"Perturbed module, seed {module.seed}"
        yield from markdown_table(title, CHECKED_HEAD, checked_rows(mine))
    if closing:
        yield from markdown_table("The loop closed", CLOSING_HEAD, closing)
        yield (
            "Mean offset from the spring of 100 N/m while the handle moves. *Thesis's model*: "
            "feed-forward with the printed friction, 10 N and a dead zone of 0.025 Nm; "
            "*identified*: with the module's own calibration; *ratio*: of the second to the first; "
            "*with feedback*: the identified model and force feedback, gain 5."
        )
        yield ""
        for module in modules[1:]:
            for title, file in drawn.get(f"seed_{module.seed}", {}).items():
                yield f"![Seed {module.seed}: {title}]({file})"
                yield ""
    changed = robustness_rows(modules)
    if changed:
        title = "Calibrated, and changed since"
        yield from markdown_table(title, robustness_head(modules), changed)
        yield (
            "Force error over all samples, rms [N]: not calibrated / calibrated / on the same rig "
            "when friction, rollers, handle and play are others than at its calibration."
        )
        yield ""
    yield "## Misses"
    yield ""
    yield from [f"- {miss.text}" for miss in misses] or ["None."]
    yield ""
    for name, outcome in thesis.outcomes.items():
        if outcome.result:
            yield from _experiment(name, outcome.result, outcome.seconds, drawn[name])


def _experiment(
    name: str, result: Result, seconds: float, figures: dict[str, str]
) -> Iterable[str]:
    yield f"## {name}"
    yield ""
    yield f"{EXPERIMENTS[name].text} *({seconds:.1f} s)*"
    yield ""
    cells = [(q.name, q.text, value_text(q)) for q in result.quantities]
    yield from markdown_table("", ("name", "quantity", "value"), cells)
    for note in result.notes:
        yield f"> {note}"
        yield ""
    for title, file in figures.items():
        yield f"![{title}]({file})"
        yield ""
    settings = "\n".join(f"    {key}: {_short(value)}" for key, value in result.settings.items())
    if settings:
        yield "Settings:"
        yield ""
        yield settings
        yield ""


def _short(value: object) -> str:
    text = str(value)
    return text if len(text) <= 400 else text[:397] + "..."
