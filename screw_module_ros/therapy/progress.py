# SPDX-License-Identifier: Apache-2.0
"""A patient's sessions side by side: eleven lines, as clinicians ask for them (hochstenbach2012).

A figure of a session is the median of its unassisted reaches, with the distribution-free interval
of its order statistics; sessions are compared with those of the same protocol and the same supports
alone. The first one of them is learning and no part of a slope. Whether a change is larger than
what another robot measured twice without one is all that is said; nothing here claims a benefit.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from datetime import datetime
from functools import cache, partial
from itertools import combinations
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from .measures import BY_NAME, Row
from .protocol import GAME, REACH
from .record import Record, local
from .report_content import labelled, number_text
from .session import RESTS

ERRORS = {
    "duration": (0.277, "inmotionretest"), "sparc": (0.277, "cornec2024"),
    "path_error": (0.421, "inmotionretest"), "pm4": (0.081, "inmotionretest"),
}  # fmt: skip
"""Smallest detectable change by figure, as a share of the mean, and the key of its source
(docs/references.md). 0.277 is 1.96 sqrt(2) of an error of measurement stated as below 10 %."""
_TAIL = 0.025  # share on each side of an interval
_LEAST = 5  # fewest sessions of a slope: four have no interval of 95 %
_NEAR = 2.0  # [N] ours: a difference between two weighings of one arm
_WEEK_S = 7 * 86400.0
_NAN = math.nan


class Point(NamedTuple):
    """A line at one session: value and interval in the line's unit, NaN for none, and as text."""

    value: float = _NAN
    low: float = _NAN
    high: float = _NAN
    text: str = "–"


class Line(NamedTuple):
    """One line over all sessions; error: smallest detectable change as a share, NaN = not known.

    base: session, from 0, with which the latest one is compared; slope, change: what is said.
    """

    label: str
    points: list[Point]
    error: float = _NAN
    base: int | None = None
    slope: str = ""
    change: str = ""


class Progress(NamedTuple):
    """What is shown of a patient: dates of the sessions, weeks since the first, and the lines."""

    patient: str
    dates: list[str]
    weeks: list[float]
    lines: list[Line]
    note: str


class _Visit(NamedTuple):
    """A session: what the record says of it, its unassisted reaches, and the scores of its day."""

    session: Any
    trials: list[Row]
    free: list[Row]
    scores: dict[str, float]


@cache
def signs(count: int) -> np.ndarray:
    """Return the probability of each number of values below the median, of `count` values."""
    found: np.ndarray = np.ones(1)
    for _ in range(count):
        found = np.convolve(found, [0.5, 0.5])
    return found


@cache
def disorders(count: int) -> np.ndarray:
    """Return the probability of each number of pairs in disorder, of `count` values by chance."""
    found: np.ndarray = np.ones(1)
    for length in range(2, count + 1):
        found = np.convolve(found, np.full(length, 1.0 / length))
    return found


def interval(values: Sequence[float], chances: np.ndarray) -> tuple[float, float]:
    """Return the innermost of the values that hold at least 95 %, NaN where no two of them do.

    chances: of each number of values below the one that is sought, from 0.
    """
    last = int(np.searchsorted(np.cumsum(chances), _TAIL, side="right")) - 1
    ordered = sorted(values)
    return (ordered[last], ordered[-1 - last]) if last >= 0 else (_NAN, _NAN)


def theil_sen(times: Sequence[float], values: Sequence[float]) -> tuple[float, float, float]:
    """Return the median slope of all pairs and its interval of 95 % (sen1968)."""
    pairs = combinations(zip(times, values, strict=True), 2)
    slopes = [(y - v) / (x - u) for (u, v), (x, y) in pairs if x != u]
    return median(slopes), *interval(slopes, disorders(len(values)))


def progress_of(record: Record, patient: str) -> Progress:
    """Return the progress of a patient. Raises ValueError for one without a dated session."""
    scores = record.scores(patient)
    visits = [_visit(row, record.trials(row), scores) for row in record.sessions(patient)
              if row["begun"] is not None]  # fmt: skip
    if not visits:
        raise ValueError(f"the record has no dated session of {patient}")
    latest = next((visit for visit in reversed(visits) if visit.free), visits[-1]).session
    same = [visit.session["protocol_sha256"] == latest["protocol_sha256"]
            and visit.session["simulated"] == latest["simulated"] for visit in visits]  # fmt: skip
    weeks = [(visit.session["begun"] - visits[0].session["begun"]) / _WEEK_S for visit in visits]
    lines = []
    for label, name, of in _LINES:
        alike = same if name else [True] * len(visits)
        points = [of(visit) if fits else Point() for visit, fits in zip(visits, alike, strict=True)]
        if name:  # under another load the same figure is another measure
            points = [point if _same_loads(visit, visits[-1]) else Point(text=point.text)
                      for visit, point in zip(visits, points, strict=True)]  # fmt: skip
        lines.append(_judged(Line(label, points), name, weeks))
    dates = [f"{local(visit.session):%Y-%m-%d %H:%M %Z}".strip() for visit in visits]
    others = len(same) - sum(same)
    note = f"Figures are of {sum(same)} sessions of {latest['protocol']}, as it was in the latest"
    less = f"; {others} of other protocols or versions have none" if others else ""
    other = "Errors of measurement are of another robot and another task (docs/therapy.md)."
    return Progress(patient, dates, weeks, lines, f"{note}{less}. {other}")


def _visit(session: Any, trials: list[Row], all_scores: Sequence[Any]) -> _Visit:
    day = local(session)
    scores = {row["scale"]: row["value"] for row in all_scores
              if day and datetime.fromisoformat(row["at"]).date() == day.date()}  # fmt: skip
    free = [row for row in trials if row["kind"] == REACH and not row["assisted"]]
    return _Visit(session, trials, free, scores)


def _same_loads(one: _Visit, other: _Visit) -> bool:
    """Return whether the unassisted reaches of two sessions had the same supports [N]."""
    loads = [sorted({round(row["support"] or 0.0) for row in visit.free}) for visit in (one, other)]
    pairs = zip(*loads, strict=False)
    return len(loads[0]) == len(loads[1]) and all(abs(a - b) <= _NEAR for a, b in pairs)


def _judged(line: Line, name: str, weeks: Sequence[float]) -> Line:
    """Say what a figure's sessions but the first one show."""
    kept = [n for n, point in enumerate(line.points) if math.isfinite(point.value)][1:]
    values = [line.points[n].value for n in kept]
    if not name or len(kept) < 2 or not values[0]:  # a path up and down has no error
        return line
    share, source = ERRORS[name]
    change = (values[-1] - values[0]) / abs(values[0])
    where = "beyond" if abs(change) > share else "within"
    said = (f"{change:+.0%} from session {kept[0] + 1} to {kept[-1] + 1}: {where} the error of "
            f"measurement ({share:.0%}, {source})")  # fmt: skip
    slope = ""
    if len(kept) >= _LEAST:
        found = theil_sen([weeks[n] for n in kept], values)
        slope = "{:+.2g} a week ({:+.2g} to {:+.2g})".format(*found)
    return line._replace(error=share, base=kept[0], slope=slope, change=said)


def _dose(visit: _Visit) -> Point:
    minutes, played = visit.session["minutes"], [r for r in visit.trials if r["kind"] == GAME]
    scores = [row["score"] for row in played if row["score"] is not None]
    ways = [row["mean_speed"] * row["duration"] for row in visit.trials
            if row["mean_speed"] is not None and row["duration"] is not None]  # fmt: skip
    moved = len(visit.trials) - len(played)
    what = [f"{moved} movements"] if moved or not played else []
    what += [f"{len(played)} min of play"] if played else []
    what += [f"score {100.0 * median(scores):.0f} %"] if scores else []
    return Point(minutes, text=f"{minutes:.0f} min, {', '.join(what)}, {sum(ways):.1f} m")


def _reached(visit: _Visit) -> Point:
    count, all_ = sum(bool(row["reached"]) for row in visit.free), len(visit.free)
    return Point(100.0 * count / all_, text=f"{count} of {all_}") if all_ else Point()


def _figure(name: str, visit: _Visit) -> Point:
    found = [row[name] * BY_NAME[name].factor for row in visit.free if row[name] is not None]
    if not found:
        return Point()
    low, high = interval(found, signs(len(found)))
    text = number_text(name, median(found))
    if math.isfinite(low):
        text = f"{text} ({number_text(name, low)} to {number_text(name, high)})"
    return Point(median(found), low, high, text)


def _at_support(visit: _Visit) -> Point:
    """Return how far he came, and the area of his circles, at each support in newtons."""
    parts = []
    for newtons in sorted({round(row["support"] or 0.0) for row in visit.trials}):
        rows = [row for row in visit.trials if round(row["support"] or 0.0) == newtons]
        told = []
        for name, of in (("pm4", [r for r in rows if r["kind"] == REACH]), ("work_area", rows)):
            if found := [row[name] for row in of if row[name] is not None]:
                measure = BY_NAME[name]
                told.append(f"{number_text(name, median(found) * measure.factor)} {measure.unit}")
        parts += [f"{newtons} N: {', '.join(told)}"] if told else []
    return _figure("pm4", visit)._replace(text="; ".join(parts) or "–")


def _help(visit: _Visit) -> Point:
    held = [row for row in visit.trials if row["assisted"]]
    newtons = visit.session["support"] or 0.0
    text = f"{newtons:.0f} N, walls in {len(held)} of {len(visit.trials)}"
    for row in held[-1:]:
        text += f", {row['slot_duration'] or 0:.2f} s, {row['side_stiffness'] or 0:.0f} N/m"
    return Point(newtons, text=text)


def _force(visit: _Visit) -> Point:
    found = [row["largest_force"] for row in visit.trials if row["largest_force"] is not None]
    return Point(max(found), text=f"{max(found):.0f} N") if found else Point()


def _pain(visit: _Visit) -> Point:
    told = [
        f"{word} {visit.scores.get(f'{scale}_before', _NAN):.0f} → "
        f"{visit.scores.get(f'{scale}_after', _NAN):.0f}".replace("nan", "?")
        for word, scale in (("pain", "pain"), ("tired", "tired"))
    ]
    return Point(visit.scores.get("pain_after", _NAN), text=", ".join(told))


def _rests(visit: _Visit) -> Point:
    rested = json.loads(visit.session["stops"]).get(RESTS, 0)
    found = rested or visit.scores.get("rests", _NAN)
    return Point(found, text=f"{found:.0f}") if math.isfinite(found) else Point()


def _stopped(visit: _Visit) -> Point:
    stops: dict[str, int] = json.loads(visit.session["stops"])
    stops.pop(RESTS, None)
    told = [f"{why} ({count})" if count > 1 else why for why, count in stops.items()]
    ends = [] if visit.session["outcome"] == "finished" else [visit.session["outcome"] or "no end"]
    return Point(float(sum(stops.values())), text="; ".join([*ends, *told]) or "nothing")


_LINES: tuple[tuple[str, str, Callable[[_Visit], Point]], ...] = (
    ("dose [min]", "", _dose),
    ("reached without help [%]", "", _reached),
    *((labelled(name), name, partial(_figure, name))
      for name in ("duration", "sparc", "path_error")),
    ("reach [mm], area, by support", "pm4", _at_support),
    ("support and assistance [N]", "", _help),
    ("largest force [N]", "", _force),
    ("pain, tiredness (0 to 10)", "", _pain),
    ("rests", "", _rests),
    ("what stopped it", "", _stopped),
)  # fmt: skip
"""Label, name of the figure that is compared, empty for none, and what a session has of it."""


def as_text(found: Progress) -> str:
    """Return the progress as a screen of text: first, second and latest session."""
    shown = sorted({0, min(1, len(found.dates) - 1), len(found.dates) - 1})
    rows = [("session", *(f"{n + 1}: {found.dates[n]}" for n in shown))]
    rows += [(line.label, *(line.points[n].text for n in shown)) for line in found.lines]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    table = ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
    said = [f"{line.label}: {'; '.join(filter(None, (line.slope, line.change)))}"
            for line in found.lines if line.change]  # fmt: skip
    head = f"{found.patient}: {len(found.dates)} sessions"
    return "\n".join([head, *table, "", *said, found.note])
