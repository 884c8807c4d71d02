# SPDX-License-Identifier: Apache-2.0
"""`session new|replay|report|export`: pseudonyms, and evaluation of recorded therapy sessions."""

from __future__ import annotations

import argparse
import csv
import io
import math
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any

from ..files import replace
from ..recording.bag import BagError
from ..recording.pseudonym import new_pseudonym, patient_folder
from .measures import COLUMNS, MEASURES
from .recorded import Recorded, in_order, read_sessions, without_copies
from .replay import replayed

LEADING = (
    "patient", "protocol", "protocol_sha256", "started", "started_ns", "simulated", "jerk_cutoff",
    "start_x", "start_y", "start_z", "target_x", "target_y", "target_z",
)  # fmt: skip
"""Columns of the export in front of the figures; started: ISO 8601, local time with its offset."""
BOM = "\ufeff"


def add_commands(commands: argparse._SubParsersAction) -> None:
    """Add the commands of therapy sessions to those of `session`."""
    new = commands.add_parser("new", help="a new pseudonym", description="Print a new pseudonym.")
    new.set_defaults(run=_new)
    for name, run, text, several in (
        ("replay", _replay, "compute a therapy session again and compare the results", False),
        ("report", _report, "a page on a patient's sessions: HTML, to read or to print", True),
        ("export", _export, "the trials of therapy sessions as CSV", True),
    ):
        command = commands.add_parser(name, help=text, description=text)
        command.add_argument(
            "bags", type=Path, nargs="+" if several else 1, help="folder of a bag", metavar="FOLDER"
        )
        if several:
            text = "output folder; a folder per patient is made in it"
            command.add_argument("--out", type=Path, required=True, help=text, metavar="FOLDER")
        if run is _export:
            text = "decimal commas and semicolons between columns, as many spreadsheets read it"
            command.add_argument("--decimal-comma", action="store_true", help=text)
            text = "a byte order mark in front, by which spreadsheets know UTF-8"
            command.add_argument("--bom", action="store_true", help=text)
        command.set_defaults(run=run)


def _new(options: argparse.Namespace) -> int:
    print(new_pseudonym())
    return 0


def _replay(options: argparse.Namespace) -> int:
    problems = 0
    for session in _read(options.bags[0]):
        found = replayed(session)
        for problem in found.problems:
            print(f"PROBLEM {problem}")
        print(found.verdict)
        problems += len(found.problems)
    return 0 if not problems else 1


def _report(options: argparse.Namespace) -> int:
    from .report import patient_of, write_report  # matplotlib takes a second

    sessions = _in_order(options.bags)
    replays = [replayed(session) for session in sessions]
    try:
        patient = patient_of(sessions)
    except ValueError as error:
        raise BagError(str(error)) from None
    with _writing(options.out):
        folder = patient_folder(options.out, patient)
        print(write_report(folder / "report.html", sessions, replays))
    return 0


def _export(options: argparse.Namespace) -> int:
    rows: dict[str, list[dict]] = {}
    for session in _in_order(options.bags):
        rows.setdefault(session.patient, []).extend(_exported(session))
    for patient, own in rows.items():
        with _writing(options.out):
            folder = patient_folder(options.out, patient)
            for name, columns, table in (
                ("trials.csv", (*LEADING, *COLUMNS), own), ("columns.csv", _MEANING, _meaning())
            ):  # fmt: skip
                text = csv_text(columns, table, options.decimal_comma)
                replace(folder / name, BOM + text if options.bom else text, private=True)
        print(folder / "trials.csv")
    return 0


def _exported(session: Recorded) -> list[dict]:
    """Return the rows of a session, with patient, protocol, date, start and target."""
    return [
        {
            "patient": session.patient,
            "protocol": session.protocol.name,
            "protocol_sha256": session.protocol_sha256,
            "started": _iso(session.local(row["started_ns"])),
            "simulated": session.is_simulated,
            **{f"{name}_{axis}": value for name in ("start", "target")
               for axis, value in zip("xyz", row[name], strict=True)},
            **row,
        }
        for row in session.trials
    ]  # fmt: skip


def _iso(time: datetime | None) -> str:
    """Return a time in ISO 8601, empty for none."""
    return "" if time is None else time.isoformat(timespec="milliseconds")


def csv_text(
    columns: Sequence[str], rows: Sequence[dict[str, Any]], decimal_comma: bool = False
) -> str:
    """Return rows as CSV; SI units, empty for NaN.

    decimal_comma: in numbers; columns are then separated by semicolons. Numbers have all digits:
    reading them gives the same bits.
    """
    stream = io.StringIO()
    separator = ";" if decimal_comma else ","
    writer = csv.writer(stream, lineterminator="\n", delimiter=separator)
    writer.writerow(columns)
    writer.writerows([_cell(row[name], decimal_comma) for name in columns] for row in rows)
    return stream.getvalue()


_MEANING = ("column", "label", "factor", "unit", "definition")


def _meaning() -> list[dict[str, Any]]:
    """Return what the measures among the columns mean: a value times `factor` is in `unit`."""
    rows = [(m.name, m.label, m.factor, m.unit, m.text) for m in MEASURES]
    return [dict(zip(_MEANING, row, strict=True)) for row in rows]


def _cell(value: Any, decimal_comma: bool) -> str:
    if isinstance(value, bool):
        return str(int(value))
    if not isinstance(value, float):
        return str(value)
    text = "" if math.isnan(value) else str(value)
    return text.replace(".", ",") if decimal_comma else text


def _read(bag: Path) -> list[Recorded]:
    remarks: list[str] = []
    try:
        return read_sessions(bag, remarks)
    except ValueError as error:  # of the protocol in it
        raise BagError(str(error)) from None
    finally:
        for remark in remarks:
            print(f"NOTE {remark}", file=sys.stderr)


@contextmanager
def _writing(root: Path) -> Iterator[None]:
    """State what prevents writing below `root`, like a full disk. Raises BagError."""
    try:
        yield
    except (OSError, ValueError) as error:
        raise BagError(f"--out {root}: {error}") from None


def _in_order(bags: list[Path]) -> list[Recorded]:
    once = {os.path.realpath(bag): bag for bag in bags}.values()  # also if named by two patterns
    sessions, notes = without_copies(session for bag in once for session in _read(bag))
    for note in notes:
        print(f"NOTE {note}", file=sys.stderr)
    return in_order(sessions)
