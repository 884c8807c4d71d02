# SPDX-License-Identifier: Apache-2.0
"""Therapy sessions in recorded bags: states, results, samples."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from datetime import datetime, timedelta, timezone
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple

from .. import graph
from ..recording.bag import BagError
from ..recording.counts import parameter
from ..recording.decoded import read_bag, topics
from ..recording.pseudonym import NAMED_DATE
from ..recording.recorder import CLOCK, PARAMETERS
from ..recording.records import notes
from .adaptation import USUAL, Assistance
from .hand import HandSample, hand_sample, ns_of, point_of
from .measures import COLUMNS, FILTERED, Row
from .protocol import Protocol
from .protocol_file import parse_protocol, sha256
from .session import State

_S = 1_000_000_000
_SIMULATED_S = 365 * 86400  # a bag that does not tell is simulated below this stamp
_TELLING = ("therapy_session", "endpoint_state", "session_recorder")
"""Nodes that tell which clock stamps are of."""
_ACTS = (State.RUNNING, State.PAUSED, State.FINISHED, State.ABORTED)
_DATE = re.compile(r"\d{4}_\d\d_\d\d-\d\d_\d\d_\d\dZ?")
_HAND, _STATE = graph.ENDPOINT_STATE, graph.THERAPY_STATE
_TRIAL, _ASSISTANCE = graph.THERAPY_TRIAL, graph.THERAPY_ASSISTANCE


class NoSession(BagError):
    """A bag that can be read holds no therapy session."""


class Act(NamedTuple):
    """A recorded change of state; after: number of the sample before it; state, reason, stamp."""

    after: int
    state: State
    reason: str
    stamp_ns: int = 0


class Recorded(NamedTuple):
    """A session as recorded in a bag.

    folder: of the bag; patient: pseudonym; protocol; acts; trials: results; changes: of assistance,
    by the names of AssistanceChange.msg; samples: of the hand, in order; protocol_sha256: of the
    executed YAML, hexadecimal, empty if the bag lacks it. recorded_at: local time at which the
    recording began, with its offset from UTC; use_sim_time: of the session's nodes; both None if
    the bag does not tell, as those of older versions and other recorders. arm_weight: at the
    beginning [N], NaN = not weighed; by_hand: number of the sample before the support was set by
    hand, and what was set [N], each time; side: of the arm, empty where nobody said; robot: what
    stands before the names of its topics; stated_ns: stamp of its first state; told: what the
    patient told of pain and tiredness, None = nothing yet, and the therapist's word, at each
    change; assistance: with which it began.
    """

    folder: Path
    patient: str
    protocol: Protocol
    acts: list[Act]
    trials: list[Row]
    changes: list[dict[str, Any]]
    samples: list[HandSample]
    protocol_sha256: str = ""
    recorded_at: datetime | None = None
    use_sim_time: bool | None = None
    arm_weight: float = math.nan
    by_hand: tuple[tuple[int, float], ...] = ()
    side: str = ""
    robot: str = "/"
    stated_ns: int = 0
    told: tuple[tuple[float | None, float | None, int], ...] = ()
    assistance: Assistance = USUAL

    @property
    def is_simulated(self) -> bool:
        """Return whether its stamps are those of a rig, which begin anew with each start of it."""
        if self.use_sim_time is not None:
            return self.use_sim_time
        return 0 <= self.stamp_ns < _SIMULATED_S * _S

    @property
    def begun(self) -> datetime | None:
        """Return the local time of its beginning, None if nothing tells it; see `local`."""
        return self.local(self.stamp_ns)

    def local(self, stamp_ns: int) -> datetime | None:
        """Return the local time of a stamp [ns] where it was recorded, None if nothing tells it.

        Stamps of the system clock are shown with the offset that the bag states, without one in
        UTC. Simulated ones count from the beginning of the recording; where the bag does not state
        it, the folder's name has it, unless it was renamed: in UTC, or, without a Z, a local time
        without an offset.
        """
        if not self.is_simulated:
            zone = self.recorded_at.tzinfo if self.recorded_at else timezone.utc
            return datetime.fromtimestamp(stamp_ns / _S, zone)
        begun = self.recorded_at or _named_date(self.folder)
        if begun is None:
            return None
        return begun + timedelta(microseconds=(stamp_ns - self.stamp_ns) // 1000)

    @property
    def stamp_ns(self) -> int:
        """Stamp of its first trial [ns], without one of its first state."""
        return self.trials[0]["started_ns"] if self.trials else self.stated_ns


def _named_date(folder: Path) -> datetime | None:
    """Return the time in a folder's name, which the session's node gives it, or None.

    It is UTC with a Z behind it; names of older versions have none, and are a local time.
    """
    found = _DATE.search(folder.resolve().name)
    try:
        form = NAMED_DATE + "%z" * (found is not None and found[0].endswith("Z"))
        return datetime.strptime(found[0], form) if found else None
    except ValueError:  # no date
        return None


def _told(folder: Path) -> tuple[datetime | None, bool | None]:
    """Return when the recording began, and whether its stamps are simulated, if a bag tells it."""
    told = notes(folder)
    try:
        begun = datetime.fromisoformat(told.get(CLOCK, {}).get("begun", ""))
    except (ValueError, TypeError):  # no date, no text
        begun = None
    values = [parameter(told.get(PARAMETERS, {}), node, "use_sim_time") for node in _TELLING]
    known = [value for value in values if isinstance(value, bool)]
    return begun if begun and begun.tzinfo else None, any(known) if known else None


def read_sessions(
    folder: Path | str, remarks: list[str] | None = None, with_samples: bool = True
) -> list[Recorded]:
    """Return the sessions in a bag, in order; a bag of an older version may contain several.

    remarks: gets what `read_bag` remarks. with_samples: False leaves out those of the hand, so that
    little more is read than the index of the bag names. Raises BagError if the bag cannot be read,
    contains no session or a protocol that does not match its hash, SettingError if its protocol is
    invalid.
    """
    folder = Path(folder)
    names = _names(folder)
    found: dict[str, list[Any]] = {name: [] for name in names.values()}
    wanted = [name for name in found if with_samples or name != names[_HAND]]
    for each in read_bag(folder, wanted, remarks, by_index=not with_samples):
        found[each.topic].append(each.message)
    states = _in_time(found[names[_STATE]])
    begins = [index for index, state in enumerate(states) if state.definition]
    if not begins:
        raise NoSession(f"{folder}: no therapy session begins in it")
    parts = [states[a:b] for a, b in zip(begins, [*begins[1:], None], strict=True)]
    trials, changes = (found.get(names.get(name, ""), []) for name in (_TRIAL, _ASSISTANCE))
    hands = _in_time(found[names[_HAND]])
    recorded_at, use_sim_time = _told(folder)
    return [
        _session(
            folder, part,
            [_trial(m) for m in trials if begin <= ns_of(m.header.stamp) < end],
            [_change(m) for m in changes if begin <= ns_of(m.header.stamp) < end],
            [m for m in hands if begin - _S <= ns_of(m.header.stamp) < end],
        )._replace(
            recorded_at=recorded_at, use_sim_time=use_sim_time,
            robot=names[_HAND].removesuffix(_HAND),
        )
        for part, (begin, end) in zip(parts, _spans(parts), strict=True)
    ]  # fmt: skip


def _spans(parts: Sequence[list[Any]]) -> list[tuple[float, float]]:
    """Return the stamps from which and until which messages belong to each session [ns].

    All belong to the only session of a bag, also if the clock was set back while it ran.
    """
    if len(parts) == 1:
        return [(-math.inf, math.inf)]
    starts = [ns_of(part[0].header.stamp) for part in parts]
    return list(zip(starts, [*starts[1:], math.inf], strict=True))


def _in_time(messages: list[Any]) -> list[Any]:
    """Return messages in the order of the monotonic clock.

    A bag is in that of the system clock, which may have been set back while it was recorded.
    Messages of older bags have no monotonic time and stay as they are.
    """
    return sorted(messages, key=lambda message: getattr(message, "monotonic_ns", 0))


def _session(
    folder: Path, states: list[Any], trials: list[Row], changes: list[dict], hands: list[Any]
) -> Recorded:
    first = states[0]
    protocol = parse_protocol(first.definition, f"recorded in {folder}")
    hashes = {getattr(state, "definition_sha256", "") for state in states}
    if not hashes <= {"", sha256(first.definition)}:
        raise BagError(
            f"{folder}: the protocol in it is not the one that was carried out: its SHA-256 is "
            f"{sha256(first.definition)}, the session states {', '.join(sorted(hashes - {''}))}"
        )
    samples = [hand_sample(message, protocol.space) for message in hands]
    trials.sort(key=itemgetter("trial"))
    changes.sort(key=itemgetter("block", "circuit"))
    acts = _acts(states, first.patient)
    return Recorded(
        folder, first.patient, protocol, acts, trials, changes, samples, max(hashes),
        arm_weight=getattr(first, "arm_weight", math.nan),
        assistance=Assistance(first.duration, first.side_stiffness),
        by_hand=tuple(dict.fromkeys(
            (int(state.support_since), state.support)
            for state in states if getattr(state, "support_since", 0)
        )),
        side=getattr(first, "side", ""), stated_ns=ns_of(first.header.stamp),
        told=tuple(dict.fromkeys(
            (_known(state.pain), _known(state.tired), int(state.goes_on))
            for state in states if hasattr(state, "goes_on")
        )),
    )  # fmt: skip


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value


def _names(folder: Path) -> dict[str, str]:
    """Return the full names of the topics of the one robot that had a session."""
    known = topics(folder)
    robots = sorted(
        topic.removesuffix(_STATE) for topic in known
        if f"/{topic}".endswith(f"/{_STATE}") and topic.removesuffix(_STATE) + _HAND in known
    )  # fmt: skip
    if not robots:
        raise NoSession(f"{folder} has not both {_HAND} and {_STATE}: no therapy session")
    if len(robots) > 1:
        robots = [robot for robot in robots if _has_session(folder, robot)] or robots[:1]
    if len(robots) != 1:
        raise BagError(
            f"{folder} has sessions of {len(robots)} robots ({', '.join(robots)}): record each"
            " robot with its own session_recorder"
        )
    names = (_HAND, _STATE, _TRIAL, _ASSISTANCE)
    return {name: robots[0] + name for name in names if robots[0] + name in known}


def _has_session(folder: Path, robot: str) -> bool:
    states = read_bag(folder, [robot + _STATE], by_index=True)
    return any(state.message.definition for state in states)


def _acts(states: list[Any], patient: str) -> list[Act]:
    """Return the changes of the state, each with the sample after which it began."""
    acts: list[Act] = []
    for state in states:
        if state.patient != patient or state.state not in _ACTS:
            continue
        act = Act(int(state.state_since), State(state.state), state.reason,
                  ns_of(state.header.stamp))  # fmt: skip
        if not acts or acts[-1][:3] != act[:3]:
            acts.append(act)
    return acts


def _trial(message: Any) -> Row:
    row: Row = {name: getattr(message, name, math.nan) for name in COLUMNS}
    row["jerk_cutoff"] = getattr(message, "jerk_cutoff", 0.0)
    lacking = {name for name in COLUMNS if not hasattr(message, name)}
    if not row["jerk_cutoff"]:  # an earlier version, whose jerk was that of the encoders' steps
        row |= dict.fromkeys(FILTERED, math.nan)
        lacking |= set(FILTERED)
    row["unmeasured"] = tuple(name for name in COLUMNS if name in lacking)
    row["start"], row["target"] = point_of(message.start), point_of(message.target)
    row["started_ns"], row["ended_ns"] = ns_of(message.started), ns_of(message.ended)
    return row


def _change(message: Any) -> dict[str, Any]:
    names = ("block", "circuit", "duration_before", "duration", "side_stiffness_before",
             "side_stiffness", "reason")  # fmt: skip
    support = {name: getattr(message, name, math.nan) for name in ("support_before", "support")}
    return {name: getattr(message, name) for name in names} | support
