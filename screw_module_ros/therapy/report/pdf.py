# SPDX-License-Identifier: Apache-2.0
"""The report as PDF: one page, and a second one with the definitions of the figures."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure

from ..bag import Recorded
from ..definitions import DEFINITIONS, EFFECT
from ..pseudonym import write_private
from ..replay import Replay
from .content import compared, middle, other_tests, rate_of, reaches, shown, summary
from .figures import assistance_figure, paths_figure, trials_figure
from .page import NOT_ADAPTED, STATEMENT, effect_text, labelled, number_text, patient_of

_A4 = (8.27, 11.69)  # [inch]
_DPI = 200
_LEFT, _WIDTH = 0.06, 0.88  # of the page
_LINE = 125  # characters
_MOST_LINES = 6  # of the latest sessions, for which the page has room; all are in the HTML
_MOST_VERDICTS = 4


def write_pdf(file: Path, sessions: Sequence[Recorded], replays: Sequence[Replay]) -> Path:
    """Write the report as PDF; arguments, errors and result as of `page.write_page`."""
    patient_of(sessions)
    stream = io.BytesIO()
    with PdfPages(stream, metadata={"CreationDate": None}) as pdf:
        pdf.savefig(front(sessions, replays))
        pdf.savefig(back())
    write_private(file, stream.getvalue())
    return file


def front(sessions: Sequence[Recorded], replays: Sequence[Replay]) -> Figure:
    """Return the first page."""
    page = Figure(figsize=_A4)
    page.text(_LEFT, 0.965, f"Sessions of {patient_of(sessions)}", size=14, weight="bold")
    note = f"{STATEMENT} Sampled at {rate_of(sessions)}. Dates: UTC."
    page.text(_LEFT, 0.95, note, size=7.5, color="#555")
    lines = _latest(sessions)
    page.text(_LEFT, 0.937, "\n".join(lines), size=7.5, va="top", linespacing=1.5)
    top = 0.93 - 0.0125 * len(lines)
    figures = [
        ("Paths to the targets, latest session", paths_figure(sessions[-1])),
        ("Figures over trials and sessions; bars are medians of each block",
         trials_figure(sessions)),
    ]  # fmt: skip
    if any(session.changes for session in sessions):
        figures.append(("Assistance", assistance_figure(sessions)))
    for title, figure in figures:
        top = _placed(page, figure, title, top)
    _closing(page, sessions, replays, top)
    return page


def _latest(sessions: Sequence[Recorded]) -> list[str]:
    """Return the lines of as many of the latest sessions as there is room for."""
    lines: list[str] = []
    for session in reversed(sessions):
        more = _session_lines(session)
        if lines and len(lines) + len(more) > _MOST_LINES:
            break
        lines = more + lines
    return lines


def _session_lines(recorded: Recorded) -> list[str]:
    row = summary(recorded)
    text = (
        f"{row.date}  {row.protocol}: {row.trials} trials, {row.course}; targets reached: "
        f"{row.reached}; started by the patient: {row.initiated}; assistance {row.assistance}; "
        f"robot's share, assisted {row.share}; samples lost {row.lost}"
    )
    return textwrap.wrap(text, _LINE, subsequent_indent="    ")


def _placed(page: Figure, figure: Figure, title: str, top: float) -> float:
    """Put a figure below `top` (share of the page); return where the next one begins."""
    canvas = FigureCanvasAgg(figure)
    figure.set_dpi(_DPI)
    canvas.draw()
    picture = np.asarray(canvas.buffer_rgba())
    width, height = figure.get_size_inches()
    share = _WIDTH * _A4[0] / width * height / _A4[1]
    page.text(_LEFT, top, title, size=9, weight="bold", va="top")
    axes = page.add_axes((_LEFT, top - 0.016 - share, _WIDTH, share))
    axes.imshow(picture, aspect="auto", interpolation="lanczos")
    axes.axis("off")
    return top - 0.026 - share


def _closing(
    page: Figure, sessions: Sequence[Recorded], replays: Sequence[Replay], top: float
) -> None:
    """Write medians, the comparison, the last change's reason and the replays' verdicts."""
    lines = _medians(sessions[-1])
    if others := other_tests(sessions[-1]):
        medians = [
            f"{title}: {labelled(name)} {number_text(name, value)}" for title, name, value in others
        ]
        lines.append(f"Medians of its other tests: {'; '.join(medians)}.")
    if found := compared(sessions):
        lines.append(f"{effect_text(found)} ({EFFECT.label}).")
    if sessions[-1].changes:
        change = sessions[-1].changes[-1]
        lines.append(f"Last change of assistance: {change['reason']}.")
    else:
        lines.append(NOT_ADAPTED)
    unequal = [
        f"{summary(session).date}: computed again from the recording: {replay.verdict}."
        for session, replay in zip(sessions, replays, strict=True)
        if replay.problems
    ]
    lines += unequal[-_MOST_VERDICTS:] or [
        "Computed again from the recordings, all results are equal, bit for bit."
    ]
    wrapped = [part for line in lines for part in textwrap.wrap(line, _LINE)]
    page.text(_LEFT, top, "\n".join(wrapped), size=7.5, va="top", linespacing=1.4)


def _medians(recorded: Recorded) -> list[str]:
    """Return the medians of a session's reaches, without and with assistance, as one sentence."""
    rows = reaches(recorded)
    groups = {
        words: kept
        for assisted, words in ((False, "without"), (True, "with"))
        if (kept := [row for row in rows if row["assisted"] is assisted])
    }
    if not groups:
        return []
    found = []
    for name in shown([recorded]):
        numbers = " / ".join(number_text(name, middle(kept, name)) for kept in groups.values())
        found.append(f"{DEFINITIONS[name].label} {numbers} {DEFINITIONS[name].unit}".rstrip())
    return [
        f"Medians of the latest session, {' / '.join(groups)} assistance: {', '.join(found)}."
    ]


def back() -> Figure:
    """Return the page with the definitions."""
    page = Figure(figsize=_A4)
    axes: Axes = page.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.axis("off")
    axes.text(_LEFT, 0.965, "What each number means", size=14, weight="bold")
    y = 0.945
    meanings = {labelled(name): definition for name, definition in DEFINITIONS.items()}
    for label, definition in (meanings | {EFFECT.label: EFFECT}).items():
        axes.text(_LEFT, y, label, size=7.5, weight="bold", va="top")
        lines = textwrap.wrap(definition.text, 100)
        axes.text(_LEFT + 0.25, y, "\n".join(lines), size=7.5, va="top", linespacing=1.25)
        y -= 0.012 * max(1, len(lines)) + 0.009
    return page
