# SPDX-License-Identifier: Apache-2.0
"""Computes a session again from its recorded samples and acts.

A complete recording gives the results of the session bit for bit. Otherwise the replay lists the
missing samples and the figures that differ, by trial.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from ..samples import sequence_gap
from .protocol import Protocol
from .record import differing, flat
from .result import Gap, TrialResult, gaps_of
from .samples import HandSample
from .session import ABORTED, PAUSED, RUNNING, Session


class Act(NamedTuple):
    """A recorded change of state; after: tick number of the sample before it; state; reason."""

    after: int
    state: str
    reason: str


class Replay(NamedTuple):
    """Result of the replay.

    results: of the trials, computed again; gaps: samples missing in the recording while the session
    ran; samples: number of recorded ones; problems: one sentence for each difference, empty if all
    results are equal.
    """

    results: list[TrialResult]
    gaps: tuple[Gap, ...]
    samples: int
    problems: list[str]

    @property
    def verdict(self) -> str:
        """Return the outcome in one sentence."""
        if not self.problems:
            return f"equal: {len(self.results)} trials from {self.samples} samples, bit for bit"
        missing = sum(gap.missing for gap in self.gaps)
        lost = f", {missing} samples missing" if missing else ", no sample missing"
        return f"NOT equal: {len(self.problems)} problems{lost}"


def replay(
    protocol: Protocol,
    samples: Iterable[HandSample],
    acts: Sequence[Act],
    recorded: Sequence[Mapping[str, Any]],
) -> Replay:
    """Compute the session's results from the samples, and compare them with the recorded ones.

    samples: of `endpoint_state`, in order; acts: from `therapy/state`; recorded: the results from
    `therapy/trial`, by the names of `record`. Raises ValueError if no act starts the session.
    """
    if not any(act.state == RUNNING for act in acts):
        raise ValueError("no therapy/state is `running`: the session's start is not recorded")
    session, used = _again(protocol, samples, list(acts))
    gaps = gaps_of(used)
    results = session.results if session is not None else []
    problems = [
        f"{gap.missing} samples missing after tick {gap.after}{_where(results, gap)}"
        for gap in gaps
    ]
    return Replay(results, gaps, len(used), problems + _differences(results, recorded))


def _again(
    protocol: Protocol, samples: Iterable[HandSample], acts: list[Act]
) -> tuple[Session | None, list[HandSample]]:
    session: Session | None = None
    used: list[HandSample] = []
    for sample in samples:
        while acts and sequence_gap(acts[0].after, sample.sequence) >= 0:
            session = _acted(protocol, session, acts.pop(0))
        if session is None or session.trial is None:
            continue
        session.take(sample)
        used.append(sample)
    return session, used


def _acted(protocol: Protocol, session: Session | None, act: Act) -> Session | None:
    if session is None:
        return Session(protocol) if act.state == RUNNING else None
    if act.state == PAUSED:
        session.pause(act.reason)
    elif act.state == RUNNING:
        session.pause(act.reason)  # a pause too short for a message: it also restarts the trial
        session.resume()
    elif act.state == ABORTED:
        session.abort(act.reason)
    return session


def _where(results: Sequence[TrialResult], gap: Gap) -> str:
    for result in results:
        if result.gaps and gap in result.gaps:
            return f", in trial {result.plan.number}"
    return ", between trials"


def _differences(
    results: Sequence[TrialResult], recorded: Sequence[Mapping[str, Any]]
) -> list[str]:
    noted = {row["trial"]: row for row in recorded}
    found = {result.plan.number: flat(result) for result in results}
    problems = []
    for number in sorted(noted.keys() | found.keys()):
        if number not in found:
            problems.append(f"trial {number}: recorded, but the replay does not complete it")
        elif number not in noted:
            problems.append(f"trial {number}: replayed, but its result was not recorded")
        else:
            names = differing(found[number], noted[number])
            if names:
                shown = ", ".join(
                    f"{name} {noted[number][name]!r} recorded, {found[number][name]!r} replayed"
                    for name in names[:3]
                )
                more = f", and {len(names) - 3} more" if len(names) > 3 else ""
                problems.append(f"trial {number}: {shown}{more}")
    return problems
