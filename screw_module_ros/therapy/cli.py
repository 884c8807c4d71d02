# SPDX-License-Identifier: Apache-2.0
"""`session new|replay|report|export`: pseudonyms, and evaluation of recorded therapy sessions."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..recording.bag import BagError
from .bag import Recorded, in_order, read_sessions, replayed
from .definitions import DEFINITIONS
from .pseudonym import new_pseudonym, patient_folder, write_private
from .record import csv_text, definitions_text

_FIRST = (
    "patient", "protocol", "protocol_sha256", "started_ns",
    "start_x", "start_y", "start_z", "target_x", "target_y", "target_z",
)  # fmt: skip
"""Columns of the export in front of the figures."""


def add_commands(commands: argparse._SubParsersAction) -> None:
    """Add the commands of therapy sessions to those of `session`."""
    new = commands.add_parser("new", help="a new pseudonym", description="Print a new pseudonym.")
    new.set_defaults(run=_new)
    for name, run, text, several in (
        ("replay", _replay, "compute a therapy session again and compare the results", False),
        ("report", _report, "one page on a patient's sessions: HTML and PDF", True),
        ("export", _export, "the trials of therapy sessions as CSV", True),
    ):
        command = commands.add_parser(name, help=text, description=text)
        command.add_argument(
            "bags", type=Path, nargs="+" if several else 1, help="folder of a bag", metavar="FOLDER"
        )
        if several:
            text = "output folder; a folder per patient is made in it"
            command.add_argument("--out", type=Path, required=True, help=text, metavar="FOLDER")
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
    from .report.page import patient_of, write_page  # matplotlib takes a second
    from .report.pdf import write_pdf

    sessions = _in_order(options.bags)
    replays = [replayed(session) for session in sessions]
    try:
        patient = patient_of(sessions)
    except ValueError as error:
        raise BagError(str(error)) from None
    with _writing(options.out):
        folder = patient_folder(options.out, patient)
        files = (
            write_page(folder / "report.html", sessions, replays),
            write_pdf(folder / "report.pdf", sessions, replays),
        )
    print(*files, sep="\n")
    return 0


def _export(options: argparse.Namespace) -> int:
    rows: dict[str, list[dict]] = {}
    for session in _in_order(options.bags):
        rows.setdefault(session.patient, []).extend(_exported(session))
    for patient, own in rows.items():
        with _writing(options.out):
            folder = patient_folder(options.out, patient)
            write_private(folder / "trials.csv", csv_text(own, _FIRST).encode())
            write_private(folder / "columns.csv", definitions_text(DEFINITIONS).encode())
        print(folder / "trials.csv")
    return 0


def _exported(session: Recorded) -> list[dict]:
    """Return the rows of a session, with patient, protocol, start and target."""
    return [
        {
            "patient": session.patient,
            "protocol": session.protocol.name,
            "protocol_sha256": session.protocol_sha256,
            **{f"{name}_{axis}": value for name in ("start", "target")
               for axis, value in zip("xyz", row[name], strict=True)},
            **row,
        }
        for row in session.trials
    ]  # fmt: skip


def _read(bag: Path) -> list[Recorded]:
    try:
        return read_sessions(bag)
    except ValueError as error:  # of the protocol in it
        raise BagError(str(error)) from None


@contextmanager
def _writing(root: Path) -> Iterator[None]:
    """State what prevents writing below `root`, like a full disk. Raises BagError."""
    try:
        yield
    except (OSError, ValueError) as error:
        raise BagError(f"--out {root}: {error}") from None


def _in_order(bags: list[Path]) -> list[Recorded]:
    once = {os.path.realpath(bag): bag for bag in bags}.values()  # also if named by two patterns
    found: dict[tuple, Recorded] = {}
    for session in (session for bag in once for session in _read(bag)):
        known = found.setdefault(session.identity, session)
        if known is not session:  # else a backup would count as a second session
            less, more = sorted((session, known), key=lambda one: len(one.samples))
            found[session.identity] = more  # a bag that was cut off has less than its copy
            print(f"NOTE {less.folder} is a copy of {more.folder}: left out", file=sys.stderr)
    return in_order(list(found.values()))
