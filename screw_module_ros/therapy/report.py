# SPDX-License-Identifier: Apache-2.0
"""The report as one self-contained HTML file that only its owner can read; a browser prints it.

The name of each figure links to its definition. The layout is in `report.html.jinja`.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib.figure import Figure

from .. import graph
from ..files import replace
from .measures import MEASURES
from .record import first_told
from .recorded import Recorded
from .replay import Replay
from .report_content import (
    has_sides,
    labelled,
    middle,
    number_text,
    other_tests,
    rate_of,
    reaches,
    shown,
    summary,
)
from .report_figures import assistance_figure, paths_figure, trials_figure

NOT_ADAPTED = "The assistance was not adapted in the latest session."
STATEMENT = (
    "This page describes recorded movements. It is no diagnosis and claims no benefit of a therapy."
)


def write_report(file: Path, sessions: Sequence[Recorded], replays: Sequence[Replay]) -> Path:
    """Write the report of one patient's sessions; return its path. Raises ValueError, OSError."""
    replace(file, report_text(sessions, replays), private=True)
    return file


def report_text(sessions: Sequence[Recorded], replays: Sequence[Replay]) -> str:
    """Return the report of one patient's sessions as HTML.

    replays: of the sessions, in the same order. Raises ValueError without a session or for sessions
    of several patients.
    """
    patient = patient_of(sessions)
    latest = sessions[-1]
    adapted = any(session.changes for session in sessions)
    pages = Environment(
        loader=PackageLoader("screw_module_ros", "therapy"), autoescape=True,
        undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    return pages.get_template("report.html.jinja").render(
        patient=patient,
        statement=STATEMENT,
        rate=rate_of(sessions),
        summaries=[summary(session) for session in sessions],
        paths=_image(paths_figure(latest)) if reaches(latest) else "",
        trials=_image(trials_figure(sessions)) if any(map(reaches, sessions)) else "",
        figures=shown(sessions),
        medians=_medians(sessions),
        others=[(summary(s).date, *test) for s in sessions for test in other_tests(s)],
        assistance=_image(assistance_figure(sessions)) if adapted else "",
        changes=latest.changes,
        has_sides=has_sides([latest]),
        not_adapted=NOT_ADAPTED,
        software=[(summary(s).date, *first_told(s, graph.SAFETY_STATE, "software"))
                  for s in sessions],
        replays=[(summary(s).date, r) for s, r in zip(sessions, replays, strict=True)],
        measures=MEASURES,
        labelled=labelled,
        number=number_text,
    )


def patient_of(sessions: Sequence[Recorded]) -> str:
    """Return the patient of the sessions. Raises ValueError as `write_report` does."""
    patients = sorted({session.patient for session in sessions})
    if len(patients) != 1:
        found = ", ".join(patients) or "none"
        raise ValueError(f"a report is of one patient's sessions; found: {found}")
    return patients[0]


def _medians(sessions: Sequence[Recorded]) -> list[tuple[str, list[str]]]:
    """Return the medians per session, without and with assistance: what they are of, and texts."""
    rows = []
    for session in sessions:
        for assisted, words in ((False, "without assistance"), (True, "with assistance")):
            kept = [row for row in reaches(session) if row["assisted"] is assisted]
            if kept:
                cells = [number_text(name, middle(kept, name)) for name in shown(sessions)]
                rows.append((f"{summary(session).date}, {words}", cells))
    return rows


def _image(figure: Figure) -> str:
    """Return a figure as the address of an image."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=130)
    return f"data:image/png;base64,{base64.b64encode(stream.getvalue()).decode()}"
