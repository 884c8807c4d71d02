# SPDX-License-Identifier: Apache-2.0
"""The report as one self-contained HTML file that only its owner can read.

The name of each figure links to its definition.
"""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Sequence
from html import escape
from pathlib import Path

from matplotlib.figure import Figure

from ..bag import Recorded
from ..definitions import DEFINITIONS, EFFECT
from ..pseudonym import write_private
from ..replay import Replay
from .content import (
    COMPARED,
    Compared,
    compared,
    has_sides,
    middle,
    other_tests,
    rate_of,
    reaches,
    shown,
    summary,
)
from .figures import assistance_figure, paths_figure, trials_figure

HEADS = (
    "session (UTC)", "protocol", "trials", "course", "targets reached", "started by the patient",
    "assistance, first → last", "robot's share of the work, assisted", "samples lost",
)  # fmt: skip
_LINKS = {
    "targets reached": "reached",
    "started by the patient": "initiated",
    "robot's share of the work, assisted": "robot_share",
    "samples lost": "missing",
}
_DECIMALS = {"mm": 1, "mm/s": 0, "%": 0, "N": 1}  # of others 2
NOT_ADAPTED = "The assistance was not adapted in the latest session."
STATEMENT = (
    "This page describes recorded movements. It is no diagnosis and claims no benefit of a therapy."
)
_STYLE = """
body { font: 14px/1.4 system-ui, sans-serif; color: #222; max-width: 56rem; margin: 1rem auto;
       padding: 0 1rem; }
h1 { font-size: 1.3rem; margin: 0; } h2 { font-size: 1rem; margin: 0.8rem 0 0.2rem; }
table { border-collapse: collapse; font-size: 12.5px; width: 100%; }
th, td { border-bottom: 1px solid #ddd; padding: 0.2rem 0.5rem; text-align: left;
         vertical-align: top; }
th { border-bottom: 2px solid #888; }
img { max-width: 100%; display: block; }
a { color: inherit; text-decoration: underline dotted; }
.note { color: #555; font-size: 12.5px; margin: 0.2rem 0; }
.bad { color: #8a3b00; font-weight: 600; }
dt { font-weight: 600; } dd { margin: 0 0 0.4rem 1.5rem; }
:target { background: #fff3c4; }
@media print { .definitions { break-before: page; } }
"""


def write_page(file: Path, sessions: Sequence[Recorded], replays: Sequence[Replay]) -> Path:
    """Write the report of one patient's sessions as HTML; return its path.

    replays: of the sessions, in the same order. Raises ValueError without a session or for sessions
    of several patients, OSError if it cannot be written.
    """
    patient = patient_of(sessions)
    latest = sessions[-1]
    parts = [
        f"<h1>Sessions of {escape(patient)}</h1>",
        f'<p class="note">{STATEMENT} Sampled at {rate_of(sessions)}.</p>',
        _table(HEADS, [summary(session) for session in sessions], _LINKS),
        "<h2>Paths to the targets, latest session</h2>",
        _image(paths_figure(latest), "Paths of the hand"),
        "<h2>Figures over trials and sessions; bars are the medians of each block</h2>",
        _image(trials_figure(sessions), "Figures over trials"),
        _medians(sessions),
        _others(sessions),
        "<h2>Assistance</h2>",
        _adapted(sessions),
        _reasons(latest),
        "<h2>Recording</h2>",
        *(_replay(session, replay) for session, replay in zip(sessions, replays, strict=True)),
        _definitions(),
    ]
    title = escape(f"Sessions of {patient}")
    page = (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{title}</title><style>{_STYLE}</style></head><body>\n"
        + "\n".join(parts)
        + "\n</body></html>\n"
    )
    write_private(file, page.encode())
    return file


def patient_of(sessions: Sequence[Recorded]) -> str:
    """Return the patient of the sessions. Raises ValueError as `write_page` does."""
    patients = sorted({session.patient for session in sessions})
    if len(patients) != 1:
        found = ", ".join(patients) or "none"
        raise ValueError(f"a report is of one patient's sessions; found: {found}")
    return patients[0]


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]], links: dict[str, str]) -> str:
    def head(text: str) -> str:
        name = links.get(text)
        return f'<a href="#{name}">{escape(text)}</a>' if name else escape(text)

    lines = ["<table><tr>" + "".join(f"<th>{head(text)}</th>" for text in heads) + "</tr>"]
    for row in rows:
        lines.append("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>")
    return "\n".join([*lines, "</table>"])


def _medians(sessions: Sequence[Recorded]) -> str:
    """Return the medians per session, without and with assistance."""
    names = shown(sessions)
    heads = ["median"] + [labelled(name) for name in names]
    rows = []
    for session in sessions:
        for assisted, words in ((False, "without assistance"), (True, "with assistance")):
            kept = [row for row in reaches(session) if row["assisted"] is assisted]
            if kept:
                cells = [number_text(name, middle(kept, name)) for name in names]
                rows.append([f"{summary(session).date}, {words}", *cells])
    return _table(heads, rows, {labelled(name): name for name in names}) + _effects(sessions)


def _effects(sessions: Sequence[Recorded]) -> str:
    """Return a sentence with the effect sizes between first and last block without assistance."""
    found = compared(sessions)
    if found is None:
        return ""
    return (
        f'<p class="note">{escape(effect_text(found))} '
        f'(<a href="#effect">{escape(EFFECT.label)}</a>).</p>'
    )


def effect_text(found: Compared) -> str:
    """Return the effect sizes of all figures shown, as a sentence without its end."""
    sizes = ", ".join(
        f"{DEFINITIONS[name].label} {signed(found.effect(name))}" for name in COMPARED
    )
    return (
        f"From the first block without assistance ({found.first_date}, {len(found.first)} reaches) "
        f"to the last ({found.last_date}, {len(found.last)}): {sizes}"
    )


def signed(value: float) -> str:
    """Return an effect size with its sign, a dash for none."""
    return f"{value:+.1f}" if math.isfinite(value) else "–"


def _others(sessions: Sequence[Recorded]) -> str:
    """Return the medians of the other tests: circles, holding, strength."""
    lines = []
    for session in sessions:
        for title, name, value in other_tests(session):
            label = f'<a href="#{name}">{escape(labelled(name))}</a>'
            cells = (escape(summary(session).date), escape(title), label, number_text(name, value))
            lines.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
    if not lines:
        return ""
    heads = "".join(f"<th>{head}</th>" for head in ("session (UTC)", "test", "figure", "median"))
    return f"<h2>Other tests</h2><table><tr>{heads}</tr>{''.join(lines)}</table>"


def labelled(name: str) -> str:
    """Return a figure's label with its unit."""
    definition = DEFINITIONS[name]
    return f"{definition.label} [{definition.unit}]" if definition.unit else definition.label


def number_text(name: str, value: float) -> str:
    """Return a figure's value with three digits, none below what its unit deserves; – for none."""
    if not math.isfinite(value):
        return "–"
    finest = _DECIMALS.get(DEFINITIONS[name].unit, 2)
    decimals = 2 - math.floor(math.log10(abs(value))) if value else finest
    return f"{value:.{max(0, min(finest, decimals))}f}"


def _adapted(sessions: Sequence[Recorded]) -> str:
    if not any(session.changes for session in sessions):
        return ""
    return _image(assistance_figure(sessions), "Assistance over the circuits")


def _reasons(recorded: Recorded) -> str:
    if not recorded.changes:
        return f'<p class="note">{NOT_ADAPTED}</p>'
    rows = [
        (
            f"{change['block']}/{change['circuit']}",
            f"{change['duration_before']:.2f} → {change['duration']:.2f} s",
            f"{change['side_stiffness_before']:.0f} → {change['side_stiffness']:.0f} N/m",
            change["reason"],
        )
        for change in recorded.changes
    ]
    heads = ("block/circuit", "time", "side walls", "why")
    if not has_sides([recorded]):
        heads, rows = heads[:2] + heads[3:], [row[:2] + row[3:] for row in rows]
    return _details(heads, rows)


def _details(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    count = "1 change" if len(rows) == 1 else f"{len(rows)} changes"
    summary_line = f"<summary>{count} in the latest session, with reasons</summary>"
    return f"<details>{summary_line}{_table(heads, rows, {})}</details>"


def _replay(recorded: Recorded, replay: Replay) -> str:
    text = f"{summary(recorded).date}: computed again from the recording: {replay.verdict}"
    return f'<p class="note{" bad" if replay.problems else ""}">{escape(text)}</p>'


def _definitions() -> str:
    lines = ['<div class="definitions"><h2>What each number means</h2><dl>']
    for name, definition in DEFINITIONS.items():
        lines.append(f'<dt id="{name}">{escape(labelled(name))}</dt>')
        lines.append(f"<dd>{escape(definition.text)}</dd>")
    lines.append(f'<dt id="effect">{escape(EFFECT.label)}</dt><dd>{escape(EFFECT.text)}</dd>')
    return "\n".join([*lines, "</dl></div>"])


def _image(figure: Figure, text: str) -> str:
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=130)
    data = base64.b64encode(stream.getvalue()).decode()
    return f'<img alt="{escape(text)}" src="data:image/png;base64,{data}">'
