# SPDX-License-Identifier: Apache-2.0
"""Exports of the record: CSV files of a patient's trials, sessions and scores.

Dates may be shifted and pseudonyms renamed. No export names a bag, whose name has both.
"""

from __future__ import annotations

import csv
import io
import secrets
from collections.abc import Callable, Iterable, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

from ..files import replace
from ..recording.pseudonym import new_pseudonym, patient_folder
from .measures import COLUMNS, MEASURES
from .record import Record, local

LEADING = (
    "patient", "protocol", "protocol_sha256", "started", "started_ns", "simulated", "jerk_cutoff",
    "start_x", "start_y", "start_z", "target_x", "target_y", "target_z",
)  # fmt: skip
"""Columns of trials.csv in front of the figures; started: ISO 8601, local time with its offset.
Behind them stands the session, a patient's first one is 1."""
SESSION = (
    "patient", "session", "side", "protocol", "level", "protocol_sha256", "started", "simulated",
    "outcome", "stops", "trials", "minutes", "support", "arm_weight", "robot", "software", "law",
)  # fmt: skip
SCORE = ("patient", "at", "scale", "value")
BOM = "\ufeff"
_MEANING = ("column", "label", "factor", "unit", "definition")
_FARTHEST = 3650  # days; the largest shift of dates; ours


class Mask(NamedTuple):
    """What a patient is called in an export, and by how many days its dates are shifted."""

    patient: str
    days: int = 0

    def date(self, found: datetime | None) -> str:
        """Return a time in ISO 8601, empty for none."""
        moved = found and found + timedelta(days=self.days)
        return moved.isoformat(timespec="milliseconds") if moved else ""


def masked(pseudonyms: Iterable[str], shifts: bool, renames: bool) -> dict[str, Mask]:
    """Return the mask of each patient, random where asked for; nothing keeps it."""
    return {
        each: Mask(
            new_pseudonym() if renames else each,
            -1 - secrets.randbelow(_FARTHEST) if shifts else 0,
        )
        for each in pseudonyms
    }


def write_tables(
    record: Record, pseudonym: str, mask: Mask, out: Path, text: Callable[..., str]
) -> Path:
    """Write the tables of a patient; return their folder. Raises OSError."""
    folder = patient_folder(out, mask.patient)
    for name, content in tables(record, pseudonym, mask, text).items():
        replace(folder / name, content, private=True)
    return folder


def tables(
    record: Record, pseudonym: str, mask: Mask, text: Callable[..., str]
) -> dict[str, str]:
    """Return trials.csv, sessions.csv, scores.csv and columns.csv of a patient.

    text: of columns and rows, as `csv_text`.
    """
    trials, sessions = list[dict](), list[dict]()
    for number, session in enumerate(record.sessions(pseudonym), 1):
        told = {**dict(session), "patient": mask.patient, "session": number}
        sessions.append({**told, "started": mask.date(local(session))})
        for row in record.trials(session):
            started = datetime.fromisoformat(row["started"]) if row["started"] else None
            moved_ns = 0 if session["simulated"] else mask.days * 86_400_000_000_000
            dates = {"started": mask.date(started), "started_ns": row["started_ns"] + moved_ns}
            trials.append(told | row | dates)
    scores = [
        {**dict(row), "patient": mask.patient, "at": mask.date(datetime.fromisoformat(row["at"]))}
        for row in record.scores(pseudonym)
    ]
    meaning = [
        dict(zip(_MEANING, (m.name, m.label, m.factor, m.unit, m.text), strict=True))
        for m in MEASURES
    ]
    return {
        "trials.csv": text((*LEADING, *COLUMNS, "session"), trials),
        "sessions.csv": text(SESSION, sessions),
        "scores.csv": text(SCORE, scores),
        "columns.csv": text(_MEANING, meaning),
    }


def csv_text(
    columns: Sequence[str], rows: Sequence[dict[str, Any]], decimal_comma: bool = False,
    bom: bool = False,
) -> str:  # fmt: skip
    """Return rows as CSV; SI units, empty where there is no value.

    decimal_comma: in numbers; columns are then separated by semicolons. bom: in front. Numbers have
    all digits: reading them gives the same bits.
    """
    stream = io.StringIO()
    separator = ";" if decimal_comma else ","
    writer = csv.writer(stream, lineterminator="\n", delimiter=separator)
    writer.writerow(columns)
    writer.writerows([_cell(row[name], decimal_comma) for name in columns] for row in rows)
    return BOM * bom + stream.getvalue()


def _cell(value: Any, decimal_comma: bool) -> str:
    if isinstance(value, bool):
        return str(int(value))
    if value is None or value != value:
        return ""
    is_comma = decimal_comma and isinstance(value, float)
    return str(value).replace(".", ",") if is_comma else str(value)
