# SPDX-License-Identifier: Apache-2.0
"""Content of the report of recorded sessions: what is shown, medians, comparison, texts."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from itertools import groupby
from statistics import median
from typing import NamedTuple

import numpy as np

from .asked import GoesOn
from .hand import VERTICAL
from .measures import BY_NAME, Row
from .protocol import CIRCLE, GAME, HOLD, REACH, RESISTED, STRENGTH, plan
from .recorded import Recorded
from .session import State

SHOWN = ("duration", "peak_speed", "path_error", "sparc", "reach_error", "robot_share")
"""Figures over trials and sessions, in the order of the page."""
OTHERS = {
    CIRCLE: ("independence", "size", "work_area", "log_jerk"),
    HOLD: ("hold_deviation",),
    RESISTED: ("pm4",),
    STRENGTH: ("largest_force", "largest_vertical_force"),
    GAME: ("score", "mean_speed"),
}
"""Figures of the other kinds of trials."""
_DECIMALS = {"mm": 1, "mm/s": 0, "%": 0, "N": 1}  # decimals by unit; others have 2


class Summary(NamedTuple):
    """One session as a row of the table, as text."""

    date: str
    protocol: str
    trials: str
    course: str
    reached: str
    initiated: str
    assistance: str
    share: str
    lost: str


def reaches(recorded: Recorded) -> list[Row]:
    """Return the reaches among the trials."""
    return [row for row in recorded.trials if row["kind"] == REACH]


def values(rows: Sequence[Row], name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return trial numbers and a figure in its unit, without NaN."""
    factor = BY_NAME[name].factor
    kept = [(row["trial"], row[name] * factor) for row in rows if math.isfinite(row[name])]
    numbers, found = zip(*kept, strict=True) if kept else ((), ())
    return np.array(numbers), np.array(found)


def middle(rows: Sequence[Row], name: str) -> float:
    """Return the median of a figure in its unit, NaN without any."""
    _, found = values(rows, name)
    return median(found.tolist()) if found.size else math.nan


def shown(sessions: Sequence[Recorded]) -> tuple[str, ...]:
    """Return the names of `SHOWN` that say something: a path up and down has no error."""
    if has_sides(sessions):
        return SHOWN
    return tuple(name for name in SHOWN if name != "path_error")


def has_sides(sessions: Sequence[Recorded]) -> bool:
    """Return whether any movement had room, and walls, beside its line."""
    return any(session.protocol.space != VERTICAL for session in sessions)


def summary(recorded: Recorded) -> Summary:
    """Return a session's row."""
    rows = reaches(recorded)
    assisted = [row for row in rows if row["assisted"]]
    share = middle(assisted, "robot_share")
    lost = sum(row["missing"] for row in recorded.trials)
    samples = sum(row["samples"] for row in recorded.trials)
    return Summary(
        date_of(recorded),
        recorded.protocol.title,
        f"{len(recorded.trials)} of {sum(1 for _ in plan(recorded.protocol))}",
        _course(recorded),
        _reached(rows),
        _share(rows, "initiated"),
        _assistance(recorded, assisted),
        f"{share:.0f} %" if math.isfinite(share) else "–",
        f"{lost} of {lost + samples}",
    )


def other_tests(recorded: Recorded) -> list[tuple[str, str, float]]:
    """Return (block's title, name of a figure, median in its unit) of the other tests."""
    found = []
    for number, block in enumerate(recorded.protocol.blocks, 1):
        rows = [row for row in recorded.trials if row["block"] == number]
        for name in OTHERS.get(block.kind, ()) if rows else ():
            found.append((block.title, name, middle(rows, name)))
    return found


def date_of(recorded: Recorded) -> str:
    """Return when the session began: local time with its offset from UTC, without one UTC.

    That of a simulated session without an offset is the local time in the folder's name.
    """
    if not recorded.trials:
        return "no trial"
    begun = recorded.begun
    if begun is None:
        return "simulated"
    date = f"{begun:%Y-%m-%d %H:%M}"
    if recorded.recorded_at:
        date = f"{date} {begun.isoformat()[-6:]}"
    return f"{date}, simulated" if recorded.is_simulated else date


def _course(recorded: Recorded) -> str:
    """Return how the session went: its pauses and, unless it was finished, how it ended."""
    reasons = Counter(act.reason for act in recorded.acts if act.state == State.PAUSED)
    parts = [f"paused{f' {n} times' if n > 1 else ''}: {why}" for why, n in reasons.items()]
    last = recorded.acts[-1]
    if last.state == State.ABORTED:
        parts.append(f"ended early: {last.reason}")
    elif last.state != State.FINISHED:
        parts.append("its end is not recorded")
    return "; ".join([*parts, *_told(recorded)]) or "complete"


def _told(recorded: Recorded) -> list[str]:
    """Return what the patient told of pain and tiredness, and whether the therapist went on."""
    parts = []
    for place, name in enumerate(("pain", "tiredness")):
        found = [row[place] for row in recorded.told if row[place] is not None]
        steps = [f"{value:.0f}" for value, _ in groupby(found)]
        parts += [f"{name} {' → '.join(steps)} of 10"] if steps else []
    words = [row[2] for row in recorded.told]
    asked = ((GoesOn.YES, "the therapist went on"), (GoesOn.NO, "the therapist ended it for that"))
    return [*parts, *(says for word, says in asked if word in words)]


def _share(rows: Sequence[Row], name: str) -> str:
    return f"{sum(bool(row[name]) for row in rows)} of {len(rows)}" if rows else "–"


def _reached(rows: Sequence[Row]) -> str:
    """Return how many targets were reached, separately without and with the robot's help."""
    free = [row for row in rows if not row["assisted"]]
    helped = [row for row in rows if row["assisted"]]
    if not (free and helped):
        return _share(rows, "reached")
    return f"{_share(free, 'reached')} without, {_share(helped, 'reached')} with assistance"


def _assistance(recorded: Recorded, assisted: Sequence[Row]) -> str:
    if not assisted:
        return "none"
    first = assisted[0]
    last = recorded.changes[-1] if recorded.changes else None
    duration = last["duration"] if last else assisted[-1]["slot_duration"]
    stiffness = last["side_stiffness"] if last else assisted[-1]["side_stiffness"]
    time = f"time {first['slot_duration']:.2f} → {duration:.2f} s"
    if not has_sides([recorded]):
        return time
    return f"{time}, side walls {first['side_stiffness']:.0f} → {stiffness:.0f} N/m"


def rate_of(sessions: Sequence[Recorded]) -> str:
    """Return the sampling rate of all sessions as text, empty without samples."""
    rates = sorted({round(row["rate"]) for s in sessions for row in s.trials if row["rate"] > 0})
    return " and ".join(f"{rate} Hz" for rate in rates)


def labelled(name: str) -> str:
    """Return a figure's label with its unit."""
    measure = BY_NAME[name]
    return f"{measure.label} [{measure.unit}]" if measure.unit else measure.label


def number_text(name: str, value: float) -> str:
    """Return a figure's value with three digits, none below what its unit deserves; – for none."""
    if not math.isfinite(value):
        return "–"
    finest = _DECIMALS.get(BY_NAME[name].unit, 2)
    decimals = 2 - math.floor(math.log10(abs(value))) if value else finest
    return f"{value:.{max(0, min(finest, decimals))}f}"
