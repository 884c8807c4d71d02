# SPDX-License-Identifier: Apache-2.0
"""Scores of a patient beside the bags: numbers that a person gives, on scales with known bounds.

Most are taken where no session runs, so no bag can hold them. What the patient tells on his screen
(`asked.py`) is kept here too, and in the bag of a session that is under way. They lie in one file a
patient, which the index of the record reads again and `session forget` deletes:

    {"scores": [{"at": "2026-03-03T13:05:00+01:00", "scale": "FM_UE", "value": 34.0}]}
"""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Annotated, NamedTuple

from ..files import replace
from ..settings import Setting, plain, validated
from ..settings_file import read_file

ENDING = "_scores.json"
SCALES = {
    "pain_before": 10.0, "pain_after": 10.0, "tired_before": 10.0, "tired_after": 10.0,
    "pain_pause": 10.0, "tired_pause": 10.0, "went_on": 1.0,
    "discomfort": 10.0, "FM_UE": 66.0, "ARAT": 57.0, "MAS_elbow": 4.0, "MAS_shoulder": 4.0,
    "rests": 100.0, "spasms": 100.0, "chair_x": 200.0, "chair_height": 200.0, "handle_angle": 180.0,
    "side": 1.0, "closed": 1.0,
}  # fmt: skip
"""Largest value by scale, the smallest is 0. 0 to 10 as the patient says, 1 where the
therapist went on after much pain or tiredness, Fugl-Meyer of the upper extremity, ARAT, modified
Ashworth (1+ is 1.5), numbers in a session, chair [cm], handle [deg], arm to be trained from now on
(0 left, 1 right), therapy ended (1) or taken up again (0)."""


class Score(NamedTuple):
    """What was found when: ISO 8601 with its offset from UTC, scale, value."""

    at: Annotated[str, Setting("when, in local time with its offset from UTC")]
    scale: Annotated[str, Setting("what was scored", choices=tuple(SCALES))]
    value: Annotated[float, Setting("how much", "", 0.0, 200.0)]

    def flaw(self) -> str:
        """Return what does not fit together."""
        try:
            dated = datetime.fromisoformat(self.at).tzinfo is not None
        except ValueError:
            dated = False
        if not dated:
            return f"at = {self.at[:40]!r}: a time like 2026-03-03T13:05:00+01:00 is wanted"
        most = SCALES[self.scale]
        return "" if self.value <= most else f"value: {self.scale} ends at {most:g}"


class _Scores(NamedTuple):
    scores: tuple[Score, ...]


def time_now() -> str:
    """Return the present local time with its offset from UTC, as a score has it."""
    return datetime.now().astimezone().isoformat(timespec="milliseconds")


def scores_in(file: Path) -> tuple[Score, ...]:
    """Return the scores in a file, none if it is not there. Raises SettingError."""
    return read_file(file, _Scores).scores if file.exists() else ()


def keep_scores(folder: Path, pseudonym: str, scores: Iterable[Score]) -> None:
    """Add scores to those of a patient, each once. Raises SettingError, OSError."""
    file = folder / f"{pseudonym}{ENDING}"
    with _one_at_a_time(folder):
        kept = sorted({*scores_in(file), *map(validated, scores)})
        replace(file, json.dumps(plain(_Scores(tuple(kept))), indent=1), private=True)


@contextmanager
def _one_at_a_time(folder: Path) -> Iterator[None]:
    """Wait until no other process adds scores in a folder: a session does, and so do the pages.

    The kernel ends the lock with the process.
    """
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)
