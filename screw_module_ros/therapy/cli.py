# SPDX-License-Identifier: Apache-2.0
"""The commands of `session` for therapy: pseudonyms, evaluation of bags, the record of patients."""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from datetime import datetime, timedelta, timezone
from functools import partial
from pathlib import Path
from typing import Any

from ..recording.bag import BagError
from ..recording.pseudonym import PseudonymError, checked_pseudonym, new_pseudonym, patient_folder
from .arm_weights import weights_file
from .bids import write_bids
from .events import actions_of, events_of
from .export import csv_text, masked, write_tables
from .keeping import BEYOND_REACH, back_up, forget, of_patient, restore
from .progress import as_text, progress_of
from .record import ACCESS, Record, alone, local, opened, sources, sum_of
from .recorded import Recorded, read_sessions
from .replay import replayed
from .scores import SCALES, Score, keep_scores, time_now

_FOLDER = "~/sessions"  # the recorder's default
_DAYS = {"y": 365.25, "m": 30.4375, "d": 1.0}


def add_commands(commands: argparse._SubParsersAction) -> None:
    """Add the commands of therapy sessions to those of `session`."""
    for name, (run, text, wanted) in _COMMANDS.items():
        command = commands.add_parser(name, help=text, description=text)
        command.set_defaults(run=run, command=name)
        for argument in wanted.split():
            command.add_argument(argument, **_ARGUMENTS[argument])


def _pseudonym(text: str) -> str:
    try:
        return text and checked_pseudonym(text)  # the default is none
    except PseudonymError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _age(text: str) -> timedelta:
    found = re.fullmatch(r"(\d{1,4})([ymd])", text)
    if found is None:
        raise argparse.ArgumentTypeError(f"{text!r}: a time like 10y, 18m or 90d is wanted")
    return timedelta(days=int(found[1]) * _DAYS[found[2]])


def _new(options: argparse.Namespace) -> int:
    print(new_pseudonym())
    return 0


def _replay(options: argparse.Namespace) -> int:
    problems, remarks = 0, list[str]()
    for session in read_sessions(options.bag, remarks):
        found = replayed(session)
        for problem in found.problems:
            print(f"PROBLEM {problem}")
        print(found.verdict)
        problems += len(found.problems)
    _tell(remarks)
    return 0 if not problems else 1


def _report(options: argparse.Namespace) -> int:
    from .report import patient_of, write_report  # matplotlib takes a second

    with _of_bags(options) as record:
        places = [(record.path(row), row["number"]) for row in record.sessions(options.patient)]
    sessions = [read_sessions(bag)[number] for bag, number in places]
    patient = patient_of(sessions)
    replays = [replayed(session) for session in sessions]
    with _writing(options.out):
        folder = patient_folder(options.out, patient)
        print(write_report(folder / "report.html", sessions, replays))
    return 0


def _export(options: argparse.Namespace) -> int:
    text = partial(csv_text, decimal_comma=options.decimal_comma, bom=options.bom)
    with _of_bags(options) as record:
        patients = dict.fromkeys(row["pseudonym"] for row in record.sessions(options.patient))
        masks = masked(patients, options.shift_dates, options.rename)
        for patient, mask in masks.items():
            with _writing(options.out):
                print(write_tables(record, patient, mask, options.out, text) / "trials.csv")
        if options.bids:
            with _writing(options.out):
                print(write_bids(record, masks, options.out / "bids"))
    return 0


def _index(options: argparse.Namespace) -> int:
    with opened(options.folder) as record:
        record.update(thorough=True)
        _tell([*record.notes, *record.copies()])
        record.note("index")
        sessions = record.sessions()
        print(f"{len(sessions)} sessions of {len({row['pseudonym'] for row in sessions})} patients")
    return 1 if record.notes else 0


def _due(options: argparse.Namespace) -> int:
    until = datetime.now(timezone.utc) - options.older
    with _of_folder(options) as record:
        last = {row["pseudonym"]: row for row in record.sessions()}
        for pseudonym, row in last.items():
            if row["begun"] is None or row["begun"] < until.timestamp():
                print(f"{pseudonym} {local(row) or 'without a date'}")
    return 0


def _access(options: argparse.Namespace) -> int:
    with opened(options.folder) as record:
        for row in record.base.execute("SELECT * FROM kept.access ORDER BY at"):
            at = datetime.fromtimestamp(row["at"]).astimezone().isoformat()
            print(at, row["who"], row["what"], row["pseudonym"], row["place"])
    return 0


def _progress(options: argparse.Namespace) -> int:
    with _of_folder(options) as record:
        print(as_text(progress_of(record, options.patient)))
    return 0


def _events(options: argparse.Namespace) -> int:
    with _of_folder(options) as record:
        return _listed(record, options, ("event", "detail"),
                       lambda of: events_of(of, record.scores(of.patient)))  # fmt: skip


def _actions(options: argparse.Namespace) -> int:
    with _of_bags(options) as record:
        return _listed(record, options, ("page", "action", "outcome", "seconds"), actions_of)


def _listed(
    record: Record, options: argparse.Namespace, names: Sequence[str],
    of: Callable[[Recorded], Iterable[tuple[Any, ...]]],
) -> int:  # fmt: skip
    """Print as CSV what `of` finds of each session: its minute, and what has these names."""
    columns = ("patient", "begun", "minute", *names, "bag")
    found = [
        (row["pseudonym"], str(local(row) or ""), round(minute, 2) + 0.0, *each, row["source"])
        for row in record.sessions(options.patient)
        for minute, *each in of(read_sessions(record.path(row))[row["number"]])
    ]
    print(csv_text(columns, [dict(zip(columns, each, strict=True)) for each in found]), end="")
    return 0


def _score(options: argparse.Namespace) -> int:
    with opened(options.folder) as record, alone(options.folder):
        score = Score(options.at or time_now(), options.scale, options.value)
        keep_scores(options.folder, options.patient, [score])
        record.note("score", options.patient)
    return 0


def _forget(options: argparse.Namespace) -> int:
    folder, patient = options.folder, options.patient
    with _of_folder(options) as record:
        own, shared = of_patient(record, folder, patient)
        rows = len(record.sessions(patient))
        print(f"To be deleted of {patient}: {rows} sessions and scores of the record, the weights "
              f"of the arms in {weights_file()}, and", *own, sep="\n  ")  # fmt: skip
        print("Write the pseudonym again to delete it:", end=" ", flush=True)
        if sys.stdin.readline().strip() != patient:
            print("nothing was deleted")
            return 1
        forget(record, folder, patient)
        beyond = [*(f"{path}, which holds others too" for path in shared), *BEYOND_REACH]
        print("Deleted. Not reached are", *beyond, sep="\n  ")
    return 0


def _backup(options: argparse.Namespace) -> int:
    with _of_folder(options) as record:
        count = back_up(record, options.folder, options.file, options.patient)
        print(f"{options.file}: {count} bags and files of scores")
    return 0


def _restore(options: argparse.Namespace) -> int:
    with opened(options.folder) as record:
        came = restore(record, options.folder, options.file)
        record.note("restore")
        record.update()
        _tell(record.notes)
        print(f"{came} bags came")
    return 0


@contextmanager
def _of_folder(options: argparse.Namespace, place: str = "") -> Iterator[Record]:
    """Open the record of a folder, take what is new, and note who asks for what."""
    with opened(options.folder) as record:
        record.update()
        _tell(record.notes)
        record.note(options.command, getattr(options, "patient", ""), place)
        yield record


@contextmanager
def _of_bags(options: argparse.Namespace) -> Iterator[Record]:
    """Open the record of the folder of bags that was named, or make one of the bags in memory."""
    folder, out = options.bags[0], str(options.out.resolve()) if "out" in options else ""
    if len(options.bags) == 1 and folder.is_dir() and sources(folder):
        options.folder = folder
        with _of_folder(options, out) as record:
            yield record
        return
    with closing(Record()) as record:
        for bag in {os.path.realpath(bag): bag for bag in options.bags}.values():
            record.add(bag, str(bag), sum_of(bag))
        _tell([*record.notes, *record.copies()])
        for above in {bag.resolve().parent for bag in options.bags}:
            if (above / ACCESS).exists():
                with opened(above) as kept:
                    for patient in {row["pseudonym"] for row in record.sessions()}:
                        kept.note(options.command, patient, out)
        yield record


def _tell(notes: list[str]) -> None:
    for note in notes:
        print(f"NOTE {note}", file=sys.stderr)


@contextmanager
def _writing(root: Path) -> Iterator[None]:
    """State what prevents writing below `root`, like a full disk. Raises BagError."""
    try:
        yield
    except (OSError, ValueError) as error:
        raise BagError(f"--out {root}: {error}") from None


_COMMANDS: dict[str, tuple[Callable[[argparse.Namespace], int], str, str]] = {
    "new": (_new, "print a new pseudonym", ""),
    "replay": (_replay, "compute a therapy session again and compare the results", "bag"),
    "report": (_report, "a page on a patient's sessions: HTML, to read or to print",
               "bags --out --patient"),
    "export": (_export, "trials, sessions and scores as CSV",
               "bags --out --patient --decimal-comma --bom --shift-dates --rename --bids"),
    "index": (_index, "bring the record up to date with the bags and scores of its folder",
              "folder"),
    "progress": (_progress, "a patient's sessions side by side, as text", "patient --folder"),
    "events": (_events, "pauses, stops, spasms, hands off and pain, by minute and bag, as CSV",
               "--patient --folder"),
    "actions": (_actions, "what was done at the pages: refused, undone, how long it took, as CSV",
                "bags --patient"),
    "score": (_score, f"keep a score of a patient: {', '.join(SCALES)}",
              "patient scale value --at --folder"),
    "due": (_due, "patients whose last session is older than a time", "--older folder"),
    "access": (_access, "who has read or written what of the record, in the last year", "folder"),
    "forget": (_forget, "delete a patient's bags, scores, reports, exports and rows",
               "patient --folder"),
    "backup": (_backup, "write bags and scores, of all or of one patient, into one file",
               "file --patient --folder"),
    "restore": (_restore, "put a backup into the record, beside what is there", "file --folder"),
}  # fmt: skip
"""By name: what runs, what it does, and its arguments."""
_PLACE = {"type": lambda text: Path(text).expanduser(), "default": _FOLDER, "metavar": "FOLDER",
          "help": "that holds the bags, by default ~/sessions"}  # fmt: skip
_FLAG = {"action": "store_true"}
_ARGUMENTS: dict[str, dict[str, Any]] = {
    "bag": {"type": Path, "metavar": "FOLDER", "help": "folder of a bag"},
    "bags": {"type": Path, "nargs": "+", "metavar": "FOLDER",
             "help": "folder of a bag, or the one that holds all bags of a record"},
    "--out": {"type": Path, "required": True, "metavar": "FOLDER",
              "help": "output folder; a folder per patient is made in it"},
    "--patient": {"type": _pseudonym, "default": "", "help": "the one patient who is wanted"},
    "--decimal-comma": {**_FLAG, "help": "decimal commas, and semicolons between columns"},
    "--bom": {**_FLAG, "help": "a byte order mark in front, by which spreadsheets know UTF-8"},
    "--shift-dates": {**_FLAG, "help": "move all dates of a patient by one random number of days"},
    "--rename": {**_FLAG, "help": "give each patient a new pseudonym, which nothing keeps"},
    "--bids": {**_FLAG, "help": "also samples and trials in the layout of BIDS, below OUT/bids"},
    "folder": {**_PLACE, "nargs": "?"},
    "--folder": _PLACE,
    "patient": {"type": _pseudonym, "help": "pseudonym"},
    "scale": {"choices": tuple(SCALES), "metavar": "SCALE", "help": "its name"},
    "value": {"type": float, "help": "number on that scale"},
    "--at": {"default": "", "help": "when, like 2026-03-03T13:05:00+01:00, by default now"},
    "--older": {"type": _age, "required": True, "metavar": "TIME", "help": "like 10y or 90d"},
    "file": {"type": Path, "help": "the backup"},
}  # fmt: skip
