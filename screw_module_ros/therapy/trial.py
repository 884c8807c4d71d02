# SPDX-License-Identifier: Apache-2.0
"""One trial as a state machine over the hand's samples.

::

    PREPARE -> WAIT -> MOVING -> OVER_TIME -> REACHED -> NONE
                          `--------------------^  `-- given up: NONE without REACHED

PREPARE brings the hand to the start and waits until it stays there. In WAIT the target is shown and
the slot is open. The movement starts when the hand moves, or after the wait. MOVING lasts for the
duration of the back wall's way, OVER_TIME until the hand reaches the target or the time limit ends.
"""

from __future__ import annotations

import math
from enum import IntEnum
from statistics import fmean as mean

from ..control.minimum_jerk import PEAK_SPEED
from ..control.slot import Slot
from .adaptation import Assistance
from .columns import Trial
from .gaps import gaps_of
from .hand import HandSample, Point, distance, speed_of
from .line import NO_SLOT, Line, SlotWish, slots
from .measures import Row, computed
from .protocol import CIRCLE, GAME, HOLD, REACH, RESISTED, STRENGTH, Block, Protocol, TrialPlan

_HELD = (HOLD, RESISTED, STRENGTH)  # kinds in which walls hold the hand to one point
_NS = 1_000_000_000
_AT_ONCE = 0.1  # [s] shortest duration of a slot


class Phase(IntEnum):
    """Phases of a trial, the constants of TherapyState.msg; NONE: it is over."""

    NONE = 0
    PREPARE = 1
    WAIT = 2
    MOVING = 3
    OVER_TIME = 4
    REACHED = 5


class PrepareError(RuntimeError):
    """The robot cannot bring the hand to the start; the message states the distance."""


class TrialCourse:
    """Processes the hand's samples one by one, from the end of the previous trial.

    kind: of the trial; phase: current phase; wish: requested slots; origin: start of the hand [m],
    on a circle the plan's target; score: what a game has told last, NaN = nothing; result: None
    before the end.
    """

    def __init__(self, protocol: Protocol, plan: TrialPlan, assistance: Assistance):
        self.plan = plan
        self.phase = Phase.PREPARE
        self.wish = NO_SLOT
        self.score = math.nan
        self.result: Row | None = None
        self._protocol = protocol
        self._rules = protocol.rules
        self._block: Block = protocol.blocks[plan.block - 1]
        self.line = Line(plan.start, plan.target, protocol.space)
        self.kind = self._block.kind
        self.origin: Point = plan.target if self._block.kind == CIRCLE else plan.start
        self._slot = slot_of(protocol, self._block, assistance)
        self._samples: list[HandSample] = []
        self._since_ns = self._start_ns = self._rest_ns = self._end_ns = 0
        self._initiated = self._reached = False
        self._turned = 0.0

    def take(self, sample: HandSample) -> None:
        """Process one sample. Raises PrepareError if the hand does not reach the start in time."""
        if self.phase == Phase.PREPARE:
            self._prepare(sample)
            return
        self._samples.append(sample)
        if self.phase == Phase.WAIT:
            self._wait(sample)
        elif self.phase in (Phase.MOVING, Phase.OVER_TIME):
            self._move(sample)
        elif self.phase == Phase.REACHED and self._passed(sample, self._end_ns) >= self._rules.hold:
            self._finish()

    def _prepare(self, sample: HandSample) -> None:
        if self.kind == GAME:
            self._show(sample)
            return
        rules, space = self._rules, self._protocol.space
        away = distance(space, sample.position, self.origin)
        if self.wish is NO_SLOT:
            self._since_ns = sample.time_ns
            way = Line(sample.position, self.origin, space)
            self.wish = slots(way, guide_of(self._protocol), sample.time_ns)
        passed = self._passed(sample, self._since_ns)
        if away > rules.hit_radius:
            self._rest_ns = 0
            if passed >= rules.prepare_duration and self.wish.start_ns == self._since_ns:
                point = Line(self.origin, self.origin, space)
                self.wish = slots(point, pull_of(self._protocol), sample.time_ns)
            if passed > rules.prepare_limit:
                raise PrepareError(
                    f"the hand is {away * 1e3:.0f} mm from the start of trial {self.plan.number} "
                    f"after {rules.prepare_limit:g} s: free it, then resume"
                )
            return
        self._rest_ns = self._rest_ns or sample.time_ns
        if self._passed(sample, self._rest_ns) >= rules.settle_time:
            self._show(sample)

    def _show(self, sample: HandSample) -> None:
        """Show the target; a trial without a reach starts at once."""
        self.phase, self._since_ns = Phase.WAIT, sample.time_ns
        self._samples = [sample]
        self.wish = self._slots(None)
        if self._block.kind in (*_HELD, GAME):
            self._start(sample, initiated=True)

    def _slots(self, start_ns: int | None) -> SlotWish:
        kind, line = self._block.kind, self.line
        if kind == GAME:
            return NO_SLOT._replace(start_ns=start_ns)
        if kind in _HELD:  # held to one point
            line = Line(self.plan.start, self.plan.start, line.space)
        return slots(line, self._slot, start_ns)

    def _wait(self, sample: HandSample) -> None:
        rules = self._rules
        if self._moves(sample):
            self._start(sample, initiated=True)
        elif self._passed(sample, self._since_ns) >= rules.wait:
            self._start(sample, initiated=False)
        if self.phase == Phase.MOVING:
            self._move(sample)

    def _moves(self, sample: HandSample) -> bool:
        """Return whether the patient has started: by speed, or by the way along the line.

        The speed limit follows from the wall's speed. Without the second rule a hand slower than
        the wall would start at the end of the wait or at the target, and seem to lead the wall.
        """
        least = self._rules.start_share * PEAK_SPEED * self.line.length / self._slot.duration
        if self._block.kind == CIRCLE:
            return speed_of(self._protocol.space, sample) >= least
        gone = self.line.gone(sample.position)
        return self.line.along(sample.velocity) >= least or gone >= self._rules.start_way

    def _start(self, sample: HandSample, initiated: bool) -> None:
        self.phase, self._start_ns, self._initiated = Phase.MOVING, sample.time_ns, initiated
        self.wish = self._slots(sample.time_ns)

    def _move(self, sample: HandSample) -> None:
        passed = self._passed(sample, self._start_ns)
        if self._block.kind == REACH:
            self._reach(sample, passed)
        elif passed >= self._block.duration or self._all_round():
            self._end_ns, self._reached = sample.time_ns, self._came(sample)
            self._finish()

    def _reach(self, sample: HandSample, passed: float) -> None:
        if self._came(sample):
            self.phase, self._end_ns, self._reached = Phase.REACHED, sample.time_ns, True
            if self._rules.hold == 0.0:
                self._finish()
        elif passed >= self._rules.give_up:
            self._end_ns = sample.time_ns
            self._finish()
        elif passed > self._slot.duration:
            self.phase = Phase.OVER_TIME

    def _came(self, sample: HandSample) -> bool:
        space, target = self._protocol.space, self.plan.target
        return distance(space, sample.position, target) <= self._rules.hit_radius

    def _all_round(self) -> bool:
        """Return whether a circle is complete: the hand has moved once around the centre."""
        if self._block.kind != CIRCLE or len(self._samples) < 2:
            return False
        cx, cy, _ = self.plan.start
        (ax, ay, _), (bx, by, _) = self._samples[-2].position, self._samples[-1].position
        ax, ay, bx, by = ax - cx, ay - cy, bx - cx, by - cy
        self._turned += math.atan2(ax * by - ay * bx, ax * bx + ay * by)
        return abs(self._turned) >= 2.0 * math.pi

    def _finish(self) -> None:
        self.phase = Phase.NONE
        plan, slot, samples = self.plan, self._slot, self._samples
        to_stamp_ns = samples[-1].stamp_ns - samples[-1].time_ns
        trial = Trial(
            self._block.kind, self.line, slot.duration, self._start_ns, self._end_ns, samples
        )
        self.result = {
            "trial": plan.number,
            "block": plan.block,
            "circuit": plan.circuit,
            "kind": self._block.kind,
            "assisted": self._block.assisted,
            "start": plan.start,
            "target": plan.target,
            "slot_duration": slot.duration,
            "side_stiffness": slot.side_stiffness,
            "initiated": self._initiated,
            "reached": self._reached,
            "moved": trial.cut is not None,
            "started_ns": self._start_ns + to_stamp_ns,
            "ended_ns": self._end_ns + to_stamp_ns,
            "first": samples[0].sequence,
            "last": samples[-1].sequence,
            "samples": len(samples),
            "missing": sum(gap.missing for gap in gaps_of(samples)),
            "rate": trial.rate,
            "support": mean(sample.support for sample in samples),
            "score": self.score,
            **computed(trial),
        }

    @staticmethod
    def _passed(sample: HandSample, since_ns: int) -> float:
        return (sample.time_ns - since_ns) / _NS


def guide_of(protocol: Protocol) -> Slot:
    """Return the slot that brings the hand to a trial's start, without start and target."""
    rules = protocol.rules
    return protocol.guidance.slot()._replace(
        duration=rules.prepare_duration,
        back_stiffness=rules.prepare_stiffness,
        side_stiffness=rules.prepare_stiffness,
        half_width=rules.hit_radius,
        end_half_width=0.2 * rules.hit_radius,
        growth=0.0,
    )


def pull_of(protocol: Protocol) -> Slot:
    """Return a tube at the start, which stiffens: a pull away from the line stops no session.

    From the line alone the hand hangs where the arm's pull and the side walls are equal.
    """
    return guide_of(protocol)._replace(
        duration=_AT_ONCE, half_width=0.0, end_half_width=0.0,
        growth=protocol.rules.prepare_growth,
    )  # fmt: skip


def slot_of(protocol: Protocol, block: Block, assistance: Assistance) -> Slot:
    """Return the slot of a block's trials, without start and target."""
    slot = protocol.guidance.slot()
    if block.kind in _HELD:
        return slot._replace(
            side_stiffness=block.stiffness, half_width=0.0, end_half_width=0.0, growth=0.0
        )
    if block.assisted:
        return slot._replace(
            duration=assistance.duration, side_stiffness=assistance.side_stiffness
        )
    return slot._replace(back_stiffness=0.0, side_stiffness=0.0, growth=0.0)
