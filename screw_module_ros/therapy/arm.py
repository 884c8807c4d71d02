# SPDX-License-Identifier: Apache-2.0
"""The arm on the handle: whose it is, what it weighs, what carries and leads it, when it pulls.

Outside of sessions two things lead it by slots: the dialogue that weighs it (`weighing.py`), and
the slot that lowers it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

from ..control.slot import Slot
from .arm_weights import ArmWeight, WeightsError, arms_of, keep
from .hand import HandSample, Point
from .line import SlotWish
from .support import BEYOND_WEIGHT, UNWEIGHED
from .weighing import Weighing

LOWERED_IN = 4.0  # [s] ours
SPASM = 60.0  # [N] ours: twice what the adaptation's walls give on a straying hand
SPASM_TIME = 0.3  # [s] ours: a stretch reflex lasts longer, a knock does not
LIGHT = 8.0  # [N] ours: a hand on which set points press with more may be an arm that hangs there
WEIGHED = "an arm is being weighed: wait, or end that"
_LOWERED = "the arm is being lowered: wait until it lies"
_LOWERED_NS = round(1e9 * (LOWERED_IN + 1.0))  # ours: a second more, for a hand that lags behind
_GONE = 0.5  # [N] ours: support that is less is no support
_NS = 1_000_000_000
_DOWN = Slot(  # ours: as damped as a slot may be, so that an arm which is heavier comes slowly
    duration=LOWERED_IN, back_stiffness=200.0, side_stiffness=200.0, damping=30.0,
    half_width=0.0, end_half_width=0.0, growth=0.0,
)  # fmt: skip
UNKNOWN = ArmWeight(math.nan, 0.0, 0)
"""Of an arm that was not weighed."""


class Arm:
    """The arm on the handle, over sessions, pauses and games.

    weight: `UNKNOWN` of one that was not weighed. told: what its dialogue waits for or has found,
    or why its weight is not known. limit, in_use: support of the controller [N], None and NaN while
    it is silent. weighing: the dialogue, lowering: the slot that leads the arm down; None without.
    """

    def __init__(self, file: Path, now_s: Callable[[], int]):
        """file: of the weights; now_s: returns the system clock [s]."""
        self.weight, self.told = UNKNOWN, ""
        self.limit: float | None = None
        self.in_use = math.nan
        self.weighing: Weighing | None = None
        self.lowering: SlotWish | None = None
        self._file, self._now_s = file, now_s
        self._of = self._carried_of = "", ""  # pseudonym and side; "" = whoever comes next
        self._force = 0.0
        self._pulls_ns: int | None = None

    @property
    def wish(self) -> SlotWish | None:
        """Return the slots that lead it, None without."""
        return self.weighing.wish if self.weighing else self.lowering

    @property
    def refusal(self) -> str:
        """Return why no session may begin, empty if one may."""
        if self.weighing:
            return WEIGHED
        return _LOWERED if self.lowering else ""

    @property
    def force(self) -> float:
        """Return what is asked for now [N], never beyond the arm's weight."""
        if self.weighing:
            return self.weighing.support
        weight = self.weight.weight
        return min(self._force, UNWEIGHED if math.isnan(weight) else weight + BEYOND_WEIGHT)

    def ask(self, force: float) -> None:
        """Ask for a support [N]; it ends a lowering."""
        self._force, self.lowering = force, None

    def ask_for_next(self, force: float) -> None:
        """Ask for a support by hand [N] while no session is under way: it stays for the next."""
        self.ask(force)
        self._carried_of = "", ""

    def know(self, patient: str, side: str) -> None:
        """Look up what a patient's arm weighs, and tell when it must be weighed."""
        if self._of == (patient, side) and self.weight is not UNKNOWN:
            return  # weighed just now; it may not have been kept
        self._of, self.weight, self.told = (patient, side), UNKNOWN, ""
        try:
            found = getattr(arms_of(self._file, patient), side, None)
        except WeightsError as error:
            self.told = str(error)
            return
        now_s = self._now_s()
        if found is not None and found.is_old(now_s):
            days = (now_s - found.weighed_s) / 86_400
            self.told = f"weighed {days:.0f} days ago, {found.weight:.1f} N then: weigh again"
        else:
            self.weight = found or UNKNOWN

    def begin(self) -> None:
        """Begin a session: nothing stays asked for that was asked for another arm."""
        own = self._carried_of in (("", ""), self._of)
        self._carried_of = self._of
        self.ask(self.force if own else 0.0)

    def weigh(self, patient: str, side: str, where: Sequence[Point], cradle: float) -> str:
        """Begin to weigh an arm, or go on; return why not, empty if done.

        where, cradle: of `Weighing`.
        """
        if self.weighing is None:
            self.weighing = Weighing(where, cradle)
            self._of = self._carried_of = patient, side
            self.weight = UNKNOWN
        elif self._of == (patient, side):
            self.weighing.press()
        else:
            return "the {1} arm of {0} is being weighed: end that first".format(*self._of)
        return ""

    def let_go(self, reason: str) -> None:
        """End at once what leads the arm: it stays where it is, with the support that there is."""
        self.lowering = None
        if self.weighing:
            self.weighing.leave(reason, at_once=True)

    def follow(self, now_ns: int) -> None:
        """Go on with what leads the arm, at now_ns [ns].

        After a weighing it stays carried with what that asked for. After a lowering the support
        goes, and then the slot.
        """
        if self.weighing:
            self._hear(self.weighing)
        elif self.lowering and now_ns - (self.lowering.start_ns or 0) >= _LOWERED_NS:
            self._force = 0.0
            if not abs(self.in_use) >= _GONE:
                self.lowering = None

    def _hear(self, weighing: Weighing) -> None:
        self.ask(weighing.support)
        self.told = weighing.told
        if not weighing.is_on:
            self.weighing = None
        if weighing.result is None:
            return
        self.weight = ArmWeight(*weighing.result, self._now_s())
        try:
            keep(self._file, *self._of, self.weight)
        except WeightsError as error:
            self.told += f"; {error}"

    def lower(self, height: float, rest_height: float, now_ns: int) -> None:
        """Begin to lower the hand from its height to where the arm lies [m], at now_ns [ns].

        Its weight still rests on the support, which goes once the arm lies: an arm whose support
        fades in the air falls.
        """
        self.lowering = SlotWish(
            vertical=_DOWN._replace(start_x=height, target_x=min(height, rest_height)),
            start_ns=now_ns,
        )

    def hangs(self, sample: HandSample) -> bool:
        """Return whether an arm may hang where it is: what presses on it beside the support."""
        fx, fy, fz = sample.force
        return not math.hypot(fx, fy, fz + self.in_use) < LIGHT

    def pulls_hard(self, sample: HandSample) -> bool:
        """Return whether the arm has pulled with more than `SPASM` for `SPASM_TIME`."""
        if not math.hypot(*sample.force) > SPASM:
            self._pulls_ns = None
            return False
        self._pulls_ns = sample.time_ns if self._pulls_ns is None else self._pulls_ns
        return sample.time_ns - self._pulls_ns >= SPASM_TIME * _NS
