# SPDX-License-Identifier: Apache-2.0
"""A session: all trials of a protocol over the hand's samples, with adaptation, pause and abort.

It uses no clock: its course depends only on the samples and on the operator's acts, so a recording
of both reproduces the session (`replay`).
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple

from .adaptation import USUAL, Assistance, Change, Circuit, adapted, beginning, circuit_of
from .hand import OTHER, PLANE, VERTICAL, HandSample, plausible
from .line import NO_SLOT, Hold, SlotWish
from .measures import Row
from .protocol import GAME, Protocol, plan
from .support import Carried
from .trial import Phase, PrepareError, TrialCourse

PULLS_HARD, PATIENT_ASKED = "the arm pulls hard", "the patient asked"
THERAPIST_PAUSED = "the therapist paused it"
"""Reasons of a pause that have a word of their own in a list of events."""
RESTS = "a rest"
"""Reason of the one pause that ends by itself."""


class State(IntEnum):
    """States of a session, the constants of TherapyState.msg."""

    IDLE = 0
    RUNNING = 1
    PAUSED = 2
    FINISHED = 3
    ABORTED = 4
    STARTING = 5

    @property
    def word(self) -> str:
        """Return it as a word in a sentence."""
        return self.name.lower()


UNDER_WAY = (State.STARTING, State.RUNNING, State.PAUSED)


class Outcome(NamedTuple):
    """Outcome of a sample: a trial's result and a change of assistance, None if there is none."""

    result: Row | None = None
    change: Change | None = None


class Session:
    """Processes the hand's samples one by one.

    state: starting, running, paused, finished or aborted; since: number of the sample after which
    that began, from which a replay knows it; reason: what it waits for, or of the pause or abort.
    What changes the state returns whether it did. assistance: current values; carried: support of
    the current block. held: what it waits for beside that, empty for nothing. results, changes:
    so far. trial: the current one, None after the end.
    """

    def __init__(
        self, protocol: Protocol, awaits: str = "", weight: float = math.nan, support: float = 0.0,
        since: int = 0, assistance: Assistance = USUAL,
    ):  # fmt: skip
        """Begin.

        awaits: what it must wait for first, until `begin`; weight: of the arm [N], NaN = not
        weighed; support: asked for until now [N]; since: number of the newest sample;
        assistance: asked for to begin with.
        """
        self.protocol = protocol
        self.since = self._newest = since
        self.state = State.STARTING if awaits else State.RUNNING
        self.reason = awaits
        guidance = protocol.guidance
        usual = Assistance(guidance.duration, guidance.side_stiffness)
        self.assistance = beginning(protocol.adaptation, usual, assistance)
        self.results: list[Row] = []
        self.changes: list[Change] = []
        self._plans = list(plan(protocol))
        self._circuits: list[Circuit] = []
        self._hold: Hold | None = None
        self._rest_s, self._rest_ns, self._newest_ns = 0.0, 0, 0  # a rest: how long, since when
        self.held = ""
        self.carried = Carried(protocol.blocks[0].support, weight, support)
        self.trial: TrialCourse | None = self._next_trial()

    @property
    def trials(self) -> int:
        """Return the number of trials of the protocol."""
        return len(self._plans)

    @property
    def progress(self) -> tuple[State, str, Phase | None]:
        """Return state, reason and phase of the trial, None without one."""
        return self.state, self.reason, self.trial.phase if self.trial else None

    @property
    def plays(self) -> bool:
        """Return whether a minute of a game runs, in which the game may pull."""
        return self.state == State.RUNNING and self.trial is not None and self.trial.kind == GAME

    def score(self, told: float) -> None:
        """Take how well the patient plays, 0 to 1; what a game tells last in a minute counts."""
        if self.trial is not None and self.plays and 0.0 <= told <= 1.0:
            self.trial.score = told

    @property
    def rest_left(self) -> float:
        """Return how much of a rest is left [s], NaN without one."""
        passed = (self._newest_ns - self._rest_ns) * 1e-9
        return self._rest_s - passed if self._rest_s else math.nan

    @property
    def wish(self) -> SlotWish:
        """Return the requested slots; none while the session does not run.

        In a rest the other axes stay held, or an arm that nothing carries would fall.
        """
        if self._rest_s:
            return NO_SLOT._replace(hold=self._hold)
        if self.state != State.RUNNING or self.trial is None:
            return NO_SLOT
        return self.trial.wish._replace(hold=self._hold)

    def take(self, sample: HandSample) -> Outcome:
        """Process one sample.

        One with `stop` or without a valid position pauses the session.
        """
        self._newest, self._newest_ns = sample.sequence, sample.time_ns
        if not (self.state == State.RUNNING or self._rest_s) or self.trial is None:
            return Outcome()
        if sample.stop or not plausible(self.protocol.space, sample):
            self.pause(sample.stop or "where the hand is, or its speed, is not known")
            return Outcome()
        if self._rest_s:
            if self.rest_left <= 0.0:
                self.resume()
            return Outcome()
        try:
            self.trial.take(sample)
        except PrepareError as error:
            self.pause(str(error))
            return Outcome()
        self._hold_others(sample, rests=self.trial.phase != Phase.PREPARE)
        result = self.trial.result
        if result is None:
            return Outcome()
        self.results.append(result)
        change = self._learn(result)
        self.trial = self._next_trial()
        if self.trial is None:
            self._change(State.FINISHED)
        elif rest := self.protocol.blocks[result["block"] - 1].rest:
            done = sum(row["block"] == result["block"] for row in self.results)
            if done % rest.every == 0:
                self.rest(rest.seconds)
        return Outcome(result, change)

    def begin(self) -> bool:
        """Begin, after what it waited for; a session that was paused meanwhile stays so."""
        if self.state != State.STARTING:
            return False
        self.reason = self.held
        return bool(self.held) or self._change(State.RUNNING)

    def rest(self, seconds: float) -> bool:
        """Pause for a time [s], then go on with the current trial from its start."""
        if self.state != State.RUNNING or not self._change(State.PAUSED, RESTS):
            return False
        self._rest_s, self._rest_ns = seconds, self._newest_ns
        return True

    def pause(self, reason: str) -> bool:
        """Pause without slots; the current trial will be repeated from its start.

        A rest becomes a pause that does not end by itself.
        """
        may = self.state in (State.STARTING, State.RUNNING) or self._rest_s and reason != RESTS
        return bool(may) and self._change(State.PAUSED, reason)

    def resume(self) -> bool:
        """Continue after a pause, or end a rest."""
        if self.state != State.PAUSED:
            return False
        self.trial = self._next_trial()
        if not self._rest_s:
            self._hold = None
        return self._change(State.RUNNING)

    def abort(self, reason: str) -> bool:
        """End the session; it cannot be resumed."""
        if self.state not in UNDER_WAY:
            return False
        self.trial = None
        return self._change(State.ABORTED, reason)

    def _change(self, state: State, reason: str = "") -> bool:
        self.state, self.reason, self.since, self._rest_s = state, reason, self._newest, 0.0
        return True

    def _hold_others(self, sample: HandSample, rests: bool) -> None:
        """Hold the axes that the protocol does not use where the hand is when it first `rests`.

        Until it rests at a start, it gives way to what pulled it before the session. While these
        axes have no torque or position nothing holds them, or they would jump with the torque.
        """
        space = self.protocol.space
        if space not in OTHER:
            return
        if not (sample.others and plausible(OTHER[space], sample)):
            self._hold = None
        elif self._hold is None and rests:
            stiffness = self.protocol.rules.hold_stiffness
            self._hold = Hold(sample.position, space == PLANE, stiffness)

    def _next_trial(self) -> TrialCourse | None:
        if len(self.results) == len(self._plans):
            return None
        return TrialCourse(self.protocol, self._plans[len(self.results)], self.assistance)

    def _learn(self, result: Row) -> Change | None:
        """Return the change after a circuit, if any."""
        upcoming = self._plans[len(self.results)] if len(self.results) < self.trials else None
        ends_block = upcoming is None or upcoming.block != result["block"]
        if upcoming and not ends_block and upcoming.circuit == result["circuit"]:
            return None
        here = result["block"], result["circuit"]
        circuit = [row for row in self.results if (row["block"], row["circuit"]) == here]
        change = self._adapt(circuit) if result["assisted"] else None
        if faded := None if ends_block else self.carried.judge([row["reached"] for row in circuit]):
            before, after, why = faded
            same = Change(result["circuit"], self.assistance, self.assistance, "")
            reason = "; ".join(filter(None, (change.reason if change else "", why)))
            change = (change or same)._replace(support_before=before, support=after, reason=reason)
        if ends_block:
            self._circuits = []
            if upcoming:
                block = self.protocol.blocks[upcoming.block - 1]
                self.carried = Carried(block.support, self.carried.weight, self.carried.force)
        if change is not None:
            self.changes.append(change)
        return change

    def _adapt(self, circuit: list[Row]) -> Change | None:
        self._circuits.append(circuit_of(circuit, circuit[-1]["side_stiffness"]))
        bounds, has_sides = self.protocol.adaptation, self.protocol.space != VERTICAL
        change = None
        if bounds is not None:
            change = adapted(bounds, self.assistance, self._circuits, has_sides)
        if change is not None:
            self.assistance = change.after
        return change
