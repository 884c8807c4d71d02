# SPDX-License-Identifier: Apache-2.0
"""Writes sessions in the layout of the Brain Imaging Data Structure for motion (BIDS 1.10).

Samples of the hand at 200 Hz or as they are: every n-th one, without a filter. The column `latency`
has the time of each, so that missing samples move none of the others.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..files import PRIVATE_FOLDER, replace
from .export import Mask
from .record import Record, local
from .recorded import Recorded, read_sessions

_RATE = 200.0  # Hz; ours
_AXES = ("position", "POS", "m"), ("velocity", "VEL", "m/s"), ("force", "MISC", "N")
_CHANNELS = (
    ("name", "component", "type", "tracked_point", "units"),
    ("latency", "n/a", "LATENCY", "hand", "s"),
    *((f"{what}_{axis}", axis, kind, "hand", unit) for what, kind, unit in _AXES for axis in "xyz"),
)


def write_bids(record: Record, masks: Mapping[str, Mask], out: Path) -> Path:
    """Write the sessions of patients below a folder; return it. Raises BagError, OSError.

    masks: what each patient is called, and how far its dates are shifted.
    """
    described = {"Name": "Therapy sessions of screw_module_ros", "BIDSVersion": "1.10.0",
                 "DatasetType": "raw", "License": "n/a"}  # fmt: skip
    _write(out / "dataset_description.json", json.dumps(described, indent=1))
    people: list[Sequence[Any]] = []
    for pseudonym, mask in masks.items():
        name, dates = f"sub-{mask.patient.removeprefix('P-')}", list[tuple]()
        sessions = record.sessions(pseudonym)
        for number, row in enumerate(sessions, 1):
            session = read_sessions(record.path(row))[row["number"]]
            _write_session(out / name / f"ses-{number:02}" / "motion", session)
            dates.append((f"ses-{number:02}", mask.date(local(row))[:19] or "n/a"))
        _table(out / name / f"{name}_sessions.tsv", [("session_id", "acq_time"), *dates])
        people.append((name, max(row["side"] for row in sessions) or "n/a"))
    _table(out / "participants.tsv", [("participant_id", "trained_arm"), *people])
    return out


def _write_session(folder: Path, session: Recorded) -> None:
    stem = f"{folder.parts[-3]}_{folder.parts[-2]}_task-{session.protocol.name.replace('_', '')}"
    rates = [row["rate"] for row in session.trials if row["rate"] > 0.0]
    step = max(1, round(max(rates, default=_RATE) / _RATE))
    begun_ns = session.samples[0].time_ns if session.samples else 0
    moments = {sample.sequence: (sample.time_ns - begun_ns) * 1e-9 for sample in session.samples}
    told = {
        "TaskName": session.protocol.name, "TaskDescription": session.protocol.title,
        "SamplingFrequency": max(rates, default=_RATE) / step, "TrackingSystemName": "robot",
    }  # fmt: skip
    trials = [
        (moments[row["first"]], moments[row["last"]] - moments[row["first"]], row["kind"],
         row["trial"], int(row["assisted"]), int(row["reached"]))
        for row in session.trials if {row["first"], row["last"]} <= moments.keys()
    ]  # fmt: skip
    samples = [(moments[s.sequence], *s[2:11]) for s in session.samples[::step]]
    of_robot = folder / f"{stem}_tracksys-robot"
    _table(Path(f"{of_robot}_motion.tsv"), samples)
    _write(Path(f"{of_robot}_motion.json"), json.dumps(told, indent=1))
    _table(Path(f"{of_robot}_channels.tsv"), _CHANNELS)
    head = ("onset", "duration", "trial_type", "trial", "assisted", "reached")
    _table(folder / f"{stem}_events.tsv", [head, *trials])


def _table(file: Path, rows: Iterable[Sequence[Any]]) -> None:
    lines = ("\t".join(map(_cell, row)) for row in rows)
    _write(file, "".join(f"{line}\n" for line in lines))


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.7g}" if value == value else "n/a"
    return str(value)


def _write(file: Path, text: str) -> None:
    for folder in reversed(file.parents):
        folder.mkdir(mode=PRIVATE_FOLDER, exist_ok=True)
    replace(file, text, private=True)
