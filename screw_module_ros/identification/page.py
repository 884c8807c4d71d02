# SPDX-License-Identifier: Apache-2.0
"""The report as a page: a summary first, contents, tables, experiments; one HTML file."""

from __future__ import annotations

import base64
import math
import re
from collections.abc import Sequence
from datetime import datetime, timezone
from html import escape
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markdown_it import MarkdownIt

from ..control import modes
from ..control.laws import names
from . import coverage
from .experiments import EXPERIMENTS
from .figures import save
from .report import (
    AGREES,
    CHECKED_HEAD,
    CLOSING_HEAD,
    COMPARED_HEAD,
    DIFFERS,
    ELSEWHERE,
    GROUPS,
    NOT_RECOVERED,
    RECOVERED,
    WRONGLY_STATED,
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
from .requirements import HEAD as REQUIREMENTS_HEAD
from .requirements import MET, MISSED, cells, sentences
from .requirements import NAME as REQUIREMENTS
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
_ROW_KINDS = {
    AGREES: "good", RECOVERED: "good", MET: "good", coverage.HOLDS: "good",
    DIFFERS: "bad", NOT_RECOVERED: "bad", WRONGLY_STATED: "bad", MISSED: "bad",
    coverage.TOO_NARROW: "bad", coverage.TOO_WIDE: "bad",
}  # fmt: skip
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
    text = markdown(report, figures, seconds, coverage.load(folder))
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


def markdown(
    report: Report, figures: Figures, seconds: float, covered: Sequence[coverage.Covered] = ()
) -> str:
    """Return the report as Markdown; its layout is in `report.md.jinja`.

    covered: hidden values over many modules, of a run of its own.
    """
    pages = Environment(
        loader=PackageLoader("screw_module_ros", "identification"), undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    required = report.modules[0].result(REQUIREMENTS)
    pages.filters |= {"value": value_text, "anchor": _anchor}
    return pages.get_template("report.md.jinja").render(
        title=_TITLE,
        report=report,
        thesis=report.modules[0],
        figures=figures,
        seconds=seconds,
        written=f"{datetime.now(timezone.utc):%Y-%m-%d %H:%M}",
        experiments=EXPERIMENTS,
        groups=GROUPS,
        like=like,
        at_rest=_at_rest(report),
        elsewhere=ELSEWHERE,
        compared_head=COMPARED_HEAD,
        compared_rows=compared_rows,
        checked_head=CHECKED_HEAD,
        checked_rows=checked_rows,
        coverage_head=coverage.HEAD,
        covered=coverage.coverage_rows(covered),
        least=coverage.least(max((row.of for row in covered), default=0)),
        closing_head=CLOSING_HEAD,
        closing=closing_rows(report.modules),
        changed_head=robustness_head(report.modules),
        changed=robustness_rows(report.modules),
        quantity_rows=lambda result: [
            (q.name, q.text, value_text(q), q.kind) for q in result.quantities
        ],
        source_rows=_source_rows,
        sentences=sentences(required) if required else (),
        required_head=REQUIREMENTS_HEAD,
        required=cells(required) if required else [],
    )


def _source_rows(result: Result) -> list[tuple[str, ...]]:
    return [
        (q.name, source.what, like(q, source.standard) if source.standard else "0",
         f"{source.freedom:.0f}" if math.isfinite(source.freedom) else "")
        for q in result.quantities for source in q.sources
    ]  # fmt: skip


def _at_rest(report: Report) -> list[str]:
    """Return the force error of a hand at rest before and after a calibration that made it larger.
    """
    found = []
    for module in report.modules:
        result = module.result("robustness")
        name = f"rms_{names()[modes.FRICTION_COMPENSATION].lower()}_holding"
        known = {q.name: q.value for q in result.quantities} if result else {}
        if f"{name}_calibrated" in known and f"{name}_uncalibrated" in known:
            before, after = known[f"{name}_uncalibrated"], known[f"{name}_calibrated"]
            if after > before:
                found.append(f"{before:.1f} N before and {after:.1f} N after ({module.name})")
    return found


def _anchor(title: str) -> str:
    return re.sub(r"\W+", "-", title.lower())


def html_page(text: str, folder: Path) -> str:
    """Return the page of a Markdown text as one file, with the figures of `folder` in it."""
    body = MarkdownIt("commonmark").enable("table").render(text)
    verdict = rf"<tr>(?=(?:(?!</tr>).)*<td>({'|'.join(_ROW_KINDS)})</td>\n</tr>)"  # in a last cell
    body = re.sub(verdict, lambda m: f'<tr class="{_ROW_KINDS[m[1]]}">', body, flags=re.DOTALL)
    body = re.sub(r"<h2>(.*?)</h2>", lambda m: f'<h2 id="{_anchor(m[1])}">{m[1]}</h2>', body)

    def embedded(found: re.Match[str]) -> str:
        data = base64.b64encode((folder / found[1]).read_bytes()).decode()
        return f'src="data:image/png;base64,{data}"'

    body = re.sub(r'src="(figures/[^"]+)"', embedded, body)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(_TITLE)}'
        f"</title><style>{_STYLE}</style></head><body>\n{body}</body></html>\n"
    )
