# SPDX-License-Identifier: Apache-2.0
"""Computes a session again from its recorded samples and acts.

A complete recording gives the results of the session bit for bit. Otherwise the replay lists the
missing samples and the figures that differ, by trial.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

from ..samples import sequence_gap
from .adaptation import USUAL, Assistance
from .gaps import Gap, gaps_of
from .hand import HandSample
from .measures import COLUMNS, Row
from .protocol import Protocol
from .recorded import Act, Recorded
from .session import Session, State


class _Kind(NamedTuple):
    """A kind of rows that are compared: names of key and values, and words of the sentences."""

    key: tuple[str, ...]
    names: tuple[str, ...]
    where: str
    act: str
    noun: str


_AGAIN = tuple(name for name in COLUMNS if name not in ("support", "score"))  # no sample tells
_TRIAL = _Kind(("trial",), _AGAIN, "trial {}", "complete", "result")
_CHANGE = _Kind(
    ("block", "circuit"),
    ("duration_before", "duration", "side_stiffness_before", "side_stiffness", "support_before",
     "support", "reason"),
    "assistance after circuit {1} of block {0}", "change", "change",
)  # fmt: skip


class Replay(NamedTuple):
    """Result of the replay.

    results: of the trials, computed again; gaps: samples missing in the recording while the session
    ran; samples: number of recorded ones; problems: one sentence for each difference, empty if all
    results are equal; unseen: recorded samples that the session counted as missing; uncompared:
    measures that the version which recorded it did not have, or computed otherwise.
    """

    results: list[Row]
    gaps: tuple[Gap, ...]
    samples: int
    problems: list[str]
    unseen: int = 0
    uncompared: tuple[str, ...] = ()

    @property
    def verdict(self) -> str:
        """Return the outcome in one sentence."""
        if not self.problems:
            equal = f"equal: {len(self.results)} trials from {self.samples} samples, bit for bit"
            less = ", ".join(self.uncompared)
            return f"{equal}; an older version has no {less} to compare" if less else equal
        missing = sum(gap.missing for gap in self.gaps)
        lost = f"{missing} samples missing" if missing else "no sample missing in the recording"
        if self.unseen:
            lost += f", but {self.unseen} recorded samples did not reach the session"
        return f"NOT equal: {len(self.problems)} problems, {lost}"


def replayed(recorded: Recorded) -> Replay:
    """Return the replay of a recorded session."""
    return replay(
        recorded.protocol, recorded.samples, recorded.acts, recorded.trials, recorded.changes,
        recorded.arm_weight, recorded.by_hand, recorded.assistance,
    )  # fmt: skip


def replay(
    protocol: Protocol,
    samples: Iterable[HandSample],
    acts: Sequence[Act],
    recorded: Sequence[Row],
    changes: Sequence[Mapping[str, Any]] | None = None,
    arm_weight: float = math.nan,
    by_hand: Sequence[tuple[int, float]] = (),
    assistance: Assistance = USUAL,
) -> Replay:
    """Compute the session's results from the samples, and compare them with the recorded ones.

    samples: of `endpoint_state`, in order; acts: from `therapy/state`; recorded: the results from
    `therapy/trial`; changes: of assistance from `therapy/assistance`, by the names of
    AssistanceChange.msg, None = not compared; arm_weight [N]; by_hand, assistance: as in
    `Recorded`. Raises ValueError if no act starts the session.
    """
    if not any(act.state == State.RUNNING for act in acts):
        raise ValueError("no therapy/state is `running`: the session's start is not recorded")
    begins = partial(Session, protocol, weight=arm_weight, assistance=assistance)
    session, used, adapted = _again(begins, samples, list(acts), list(by_hand))
    gaps = gaps_of(used)
    results = session.results if session is not None else []
    problems = [
        f"{gap.missing} samples missing after tick {gap.after}{_where(results, gap)}"
        for gap in gaps
    ]
    unseen = _unseen(results, recorded)
    problems += [
        f"trial {number}: {missing} recorded samples did not reach the session"
        for number, missing in unseen.items()
    ]
    problems += _compared(_TRIAL, recorded, results)
    if changes is not None:
        problems += _compared(_CHANGE, changes, adapted)
    uncompared = dict.fromkeys(name for row in recorded for name in row.get("unmeasured", ()))
    return Replay(results, gaps, len(used), problems, sum(unseen.values()), tuple(uncompared))


def _again(
    begins: Callable[[], Session], samples: Iterable[HandSample], acts: list[Act],
    by_hand: list[tuple[int, float]],
) -> tuple[Session | None, list[HandSample], list[dict[str, Any]]]:
    """Return the session, the samples it used, and its changes of assistance."""
    session: Session | None = None
    used: list[HandSample] = []
    adapted: list[dict[str, Any]] = []
    for sample in samples:
        while acts and sequence_gap(acts[0].after, sample.sequence) >= 0:
            session = _acted(begins, session, acts.pop(0))
        while by_hand and sequence_gap(by_hand[0][0], sample.sequence) >= 0:
            _, force = by_hand.pop(0)
            if session is not None:
                session.carried.set_by_hand(force)
        if session is None or session.trial is None:
            continue
        outcome = session.take(sample)
        used.append(sample)
        if outcome.change is not None and outcome.result is not None:
            adapted.append(outcome.change.row(outcome.result["block"]))
    return session, used, adapted


def _acted(
    begins: Callable[[], Session], session: Session | None, act: Act
) -> Session | None:
    if session is None:
        started = act.state == State.RUNNING
        return begins() if started else None
    if act.state == State.PAUSED:
        session.pause(act.reason)
    elif act.state == State.RUNNING:
        session.pause(act.reason)  # a pause too short for a message: it also restarts the trial
        session.resume()
    elif act.state == State.ABORTED:
        session.abort(act.reason)
    return session


def _where(results: Sequence[Row], gap: Gap) -> str:
    for row in results:
        begun, ends = sequence_gap(row["first"], gap.after), sequence_gap(gap.after, row["last"])
        if row["missing"] and begun >= -1 and ends >= 0:
            return f", in trial {row['trial']}"
    return ", between trials"


def _unseen(results: Sequence[Row], recorded: Sequence[Row]) -> dict[int, int]:
    """Return by trial how many samples the session counted as missing that are recorded."""
    missing = {row["trial"]: row["missing"] for row in recorded}
    unseen = {row["trial"]: missing.get(row["trial"], 0) - row["missing"] for row in results}
    return {number: count for number, count in unseen.items() if count > 0}


def _compared(
    kind: _Kind, recorded: Sequence[Mapping[str, Any]], again: Sequence[Mapping[str, Any]]
) -> list[str]:
    """Return one sentence for each row that was recorded or replayed alone, or otherwise."""
    noted, found = ({tuple(row[k] for k in kind.key): row for row in rows}
                    for rows in (recorded, again))  # fmt: skip
    problems = []
    for key in sorted(noted.keys() | found.keys()):
        where = kind.where.format(*key)
        if key not in found:
            problems.append(f"{where}: recorded, but the replay does not {kind.act} it")
        elif key not in noted:
            problems.append(f"{where}: replayed, but its {kind.noun} was not recorded")
        elif shown := _differing(noted[key], found[key], kind.names):
            more = f", and {len(shown) - 3} more" if len(shown) > 3 else ""
            problems.append(f"{where}: {', '.join(shown[:3])}{more}")
    return problems


def _differing(old: Mapping[str, Any], new: Mapping[str, Any], names: Sequence[str]) -> list[str]:
    """Return one phrase for each value that differs; what is unmeasured is left out."""
    unmeasured = old.get("unmeasured", ())
    return [
        f"{name} {old[name]!r} recorded, {new[name]!r} replayed"
        for name in names
        if name not in unmeasured
        and old[name] != new[name]
        and not (_is_nan(old[name]) and _is_nan(new[name]))
    ]


def _is_nan(value: Any) -> bool:
    return isinstance(value, float) and math.isnan(value)
