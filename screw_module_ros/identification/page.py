# SPDX-License-Identifier: Apache-2.0
"""The report as a page: a summary first, contents, tables, experiments; one HTML file."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime, timezone
from html import escape
from pathlib import Path

from markdown_it import MarkdownIt

from ..control import modes
from .experiments import EXPERIMENTS
from .figures import save
from .report import (
    AGREES,
    CALCULATION,
    CHECKED_HEAD,
    CLOSING_HEAD,
    COMPARED_HEAD,
    COMPATIBLE,
    DIFFERS,
    GROUPS,
    INPUT,
    PREDICTION,
    Module,
    Report,
    checked_rows,
    closing_rows,
    compared_rows,
    like,
    robustness_head,
    robustness_rows,
    value_text,
)
from .results import Result

PAGE, TEXT = "report.html", "report.md"
_TITLE = "The thesis's characterization, repeated"
_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 62rem; margin: 2rem auto;
       padding: 0 1rem; }
table { border-collapse: collapse; margin: 1rem 0; font-size: 13.5px; }
th, td { border-bottom: 1px solid #ddd; padding: 0.3rem 0.7rem; text-align: left;
         vertical-align: top; }
th { border-bottom: 2px solid #888; }
tr.good td:last-child { color: #00734f; }
tr.bad td:last-child { color: #b33a00; font-weight: 600; }
img { max-width: 100%; margin: 0.5rem 0; }
blockquote { margin: 0.5rem 0; padding: 0 1rem; border-left: 3px solid #0072b2; color: #444; }
pre { background: #f6f6f6; padding: 0.6rem; overflow-x: auto; font-size: 12px; }
"""
_ROW_KINDS = {AGREES: "good", "recovered": "good", DIFFERS: "bad", "MISSED": "bad"}
Figures = dict[str, dict[str, str]]
"""Title -> file beside the page, of each experiment and, as `seed_N`, of each perturbed module."""


def write_page(folder: Path, modules: Sequence[Module], seconds: float) -> tuple[Path, Report]:
    """Draw the figures, write report.md and report.html; return the page. Raises OSError."""
    report = Report(modules)
    figures = {
        name: _drawn(name, outcome.result, folder)
        for name, outcome in modules[0].outcomes.items() if outcome.result
    }  # fmt: skip
    for module in modules[1:]:
        if result := module.result("compensation"):
            prefix = f"seed_{module.seed}"
            figures[prefix] = _drawn("compensation", result, folder, f"{prefix}-")
    text = "\n".join(_text(report, figures, seconds))
    (folder / TEXT).write_text(text, encoding="utf-8")
    page = folder / PAGE
    page.write_text(html_page(text, folder), encoding="utf-8")
    return page, report


def _drawn(experiment: str, result: Result, folder: Path, prefix: str = "") -> dict[str, str]:
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    files = {}
    for name, figure in EXPERIMENTS[experiment].draw(result).items():
        file = f"figures/{prefix}{experiment}-{name.replace(' ', '_')}.png"
        save(figure, folder / file)
        files[figure.axes[0].get_title("left") or f"{experiment}, {name}"] = file
    return files


def _text(report: Report, figures: Figures, seconds: float) -> Iterator[str]:
    """Yield the lines of the Markdown report."""
    thesis, *others = report.modules
    yield from (f"# {_TITLE}", "")
    yield from _summary(report)
    yield from _contents(report)
    yield from (
        "## How it was made", "",
        "S. P. Buerger, *Characterization and Control of an Interactive Robot*, MIT 2001: every "
        "experiment of chapters 4 to 6 and appendices A, C and D, run in process on the simulated "
        f"module. Written {datetime.now(timezone.utc):%Y-%m-%d %H:%M} UTC by `make reproduce` in "
        f"{seconds:.0f} s; a trial finished by an earlier, interrupted run is not repeated. "
        f"Perturbed modules by seed: {', '.join(str(m.seed) for m in others) or 'none'}. Noise: "
        "seed 1, or the module's own.", "",
    )  # fmt: skip
    for group, title in GROUPS.items():
        yield from _table(title, COMPARED_HEAD, compared_rows(report.compared, group))
        yield from (_MEANING[group], "")
    yield from (
        "*agrees*: within what the thesis's own scatter, a figure read off a plot, or the plant's "
        "deliberate differences (stiction, Stribeck, backlash, noise) allow. *compatible*: the "
        "same, but the tolerance is wider than 30 % of the figure, so it shows little.", "",
    )  # fmt: skip
    yield from _table("Hidden values", CHECKED_HEAD, checked_rows(report.checked))
    yield from (
        "The truth is read from the plant's parameters for this table alone; no experiment sees "
        "it.", "",
    )  # fmt: skip
    yield from _closed(report, figures)
    yield from ("## Misses", "")
    yield from [f"- {miss.text}" for miss in report.misses] or ["None."]
    yield ""
    for name, outcome in thesis.outcomes.items():
        if outcome.result:
            yield from _experiment(name, outcome.result, outcome.seconds, figures[name])


_MEANING = {
    PREDICTION: "These follow from plant and law and were given to neither.",
    INPUT: "These values stand in the plant's own file: to find them again shows that the method "
    "works on a module with play, stiction and noise, and nothing about the thesis's module. The "
    "offset without compensation is the friction of 5.2, given to the plant as well.",
    CALCULATION: "Arithmetic on printed values, without a trial: agreement means that the text was "
    "read as it was meant, or, for plane and belt of appendix D, that parameters chosen to "
    "reproduce a figure do so. They count as no agreement.",
}


def _summary(report: Report) -> Iterator[str]:
    """Yield the first page: what agrees, what was missed, and what that means."""
    yield from ("## In short", "", f"**{report.headline}.**", "")
    inputs, calculations = report.counts(INPUT), report.counts(CALCULATION)
    met = sum(row.met for row in report.checked)
    yield (
        f"- Apart from these, {inputs[AGREES] + inputs[COMPATIBLE]} of {sum(inputs.values())} "
        "printed values that the plant was given were found again."
    )
    yield (
        f"- {calculations[AGREES] + calculations[COMPATIBLE]} of {sum(calculations.values())} "
        "calculations give the printed number; they are not counted as agreement."
    )
    yield (
        f"- {met} of {len(report.checked)} hidden values and marks were reached; modules: "
        f"{', '.join(module.name for module in report.modules)}."
    )
    yield from ("", "**What was missed, and what it means**", "")
    dynamic = [row for row in report.compared if row.group == PREDICTION]
    for experiment, ours in (row for row in dynamic if row.verdict == DIFFERS):
        yield (
            f"- *{experiment}, {ours.text}*: the thesis has {ours.thesis.value:g}, we have "
            f"{value_text(ours)}: {ours.thesis.why or 'no explanation is known'}."
        )
    if any(row.verdict == DIFFERS for row in dynamic):
        yield (
            "- It means: the simulated module is no evidence for how large a force gain a real one "
            "bears. Gains for a patient come from that module's own certificate."
        )
    others = [row for row in report.compared if row.group != PREDICTION and row.verdict == DIFFERS]
    for experiment, ours in others:
        yield (
            f"- *{experiment}, {ours.text}*: printed {like(ours, ours.thesis.value)}, ours "
            f"{value_text(ours)}: {ours.thesis.why or 'no explanation is known'}."
        )
    serious = [miss for miss in report.misses if miss.serious]
    yield from [f"- **Not explained**: {miss.text}" for miss in serious]
    if not others and not serious and all(row.verdict != DIFFERS for row in dynamic):
        yield "- Nothing."
    yield from _at_rest(report)
    yield ""


def _at_rest(report: Report) -> Iterator[str]:
    """Yield why calibrated feed-forward is worse on a hand at rest, where it was measured."""
    rows = []
    for module in report.modules:
        result = module.result("robustness")
        name = f"rms_{modes.MODE_NAMES[modes.FRICTION_COMPENSATION].lower()}_holding"
        known = {q.name: q.value for q in result.quantities} if result else {}
        if f"{name}_calibrated" in known and f"{name}_uncalibrated" in known:
            before, after = known[f"{name}_uncalibrated"], known[f"{name}_calibrated"]
            rows.append(f"{before:.1f} N before and {after:.1f} N after ({module.name} module)")
    if rows:
        yield (
            f"- *Mode 2 at rest*: the force error of a hand that holds still is {'; '.join(rows)}. "
            "A calibration identifies friction in motion. On a handle that stands, friction is "
            "whatever keeps it there, and the law goes on feeding forward what it fed in the last "
            "motion. A better model takes more of the moving friction away: less is left to hold "
            "the handle against that force, and the hand carries the rest. Mode 2 is for motion; "
            "modes 3 to 5 measure the hand's force and correct this."
        )


def _contents(report: Report) -> Iterator[str]:
    yield from ("## Contents", "")
    titles = [*GROUPS.values(), "Hidden values", "The loop closed", "Calibrated, and changed since"]
    names = [name for name, outcome in report.modules[0].outcomes.items() if outcome.result]
    for title in titles + ["Misses"]:
        yield f"- [{title}](#{_anchor(title)})"
    for name in names:
        yield f"- [{name}](#{_anchor(name)}): {EXPERIMENTS[name].text}"
    yield ""


def _closed(report: Report, figures: Figures) -> Iterator[str]:
    """Yield what the identified model is worth on every module, with its figures."""
    if closing := closing_rows(report.modules):
        yield from _table("The loop closed", CLOSING_HEAD, closing)
        yield from (
            "Mean offset from the spring of 100 N/m while the handle moves. *Thesis's model*: "
            "feed-forward with the printed friction, 10 N and a dead zone of 0.025 Nm. On the "
            "thesis's module that friction is the plant's own polynomial, so it cannot fail there; "
            "the perturbed modules show what it is worth on another one. *identified*: with the "
            "module's own calibration; *ratio*: of the second to the first; *with feedback*: the "
            "identified model and force feedback, gain 5.", "",
        )  # fmt: skip
        for name in ("compensation", *(f"seed_{m.seed}" for m in report.modules[1:])):
            for title, file in figures.get(name, {}).items():
                yield from (f"![{name}: {title}]({file})", "")
    if changed := robustness_rows(report.modules):
        title = "Calibrated, and changed since"
        yield from _table(title, robustness_head(report.modules), changed)
        yield from (
            "Force error over all samples, rms [N]: not calibrated / calibrated / on the same rig "
            "when friction, rollers, handle and play are others than at its calibration.", "",
        )  # fmt: skip


def _experiment(
    name: str, result: Result, seconds: float, figures: dict[str, str]
) -> Iterator[str]:
    yield from (f"## {name}", "", f"{EXPERIMENTS[name].text} *({seconds:.1f} s)*", "")
    cells = [(q.name, q.text, value_text(q), q.kind) for q in result.quantities]
    yield from _table("", ("name", "quantity", "value", "kind"), cells)
    for note in result.notes:
        yield from (f"> {note}", "")
    for title, file in figures.items():
        yield from (f"![{title}]({file})", "")
    if result.settings:
        lines = [f"    {key}: {_short(value)}" for key, value in result.settings.items()]
        yield from ("Settings:", "", *lines, "")


def _short(value: object) -> str:
    text = str(value)
    return text if len(text) <= 400 else text[:397] + "..."


def _table(title: str, head: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """Yield a Markdown table."""
    if title:
        yield from (f"## {title}", "")
    yield "| " + " | ".join(head) + " |"
    yield "|" + "---|" * len(head)
    for row in rows:
        yield "| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |"
    yield ""


def _anchor(title: str) -> str:
    return re.sub(r"\W+", "-", title.lower())


def html_page(text: str, folder: Path) -> str:
    """Return the page of a Markdown text as one file, with the figures of `folder` in it."""
    body = MarkdownIt("commonmark").enable("table").render(text)
    for verdict, kind in _ROW_KINDS.items():
        cell = f"<td>{verdict}</td>\n</tr>"
        parts = body.split(cell)
        for index in range(len(parts) - 1):
            before, _, row = parts[index].rpartition("<tr>")
            parts[index] = f'{before}<tr class="{kind}">{row}'
        body = cell.join(parts)
    body = re.sub(r"<h2>(.*?)</h2>", lambda m: f'<h2 id="{_anchor(m[1])}">{m[1]}</h2>', body)

    def embedded(found: re.Match) -> str:
        data = base64.b64encode((folder / found[1]).read_bytes()).decode()
        return f'src="data:image/png;base64,{data}"'

    body = re.sub(r'src="(figures/[^"]+)"', embedded, body)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(_TITLE)}'
        f"</title><style>{_STYLE}</style></head><body>\n{body}</body></html>\n"
    )
