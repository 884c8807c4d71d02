# SPDX-License-Identifier: Apache-2.0
"""Support of the arm's weight: how much may be asked for, how the arm is lowered, when it pulls.

A therapist asks for a constant force S on the hand, up positive; `control/support.py` gives it. It
stays at a pause and at the end of a session, until the arm is lowered.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import fmean as mean
from typing import Annotated, NamedTuple

from ..control.limits import clamp, slew
from ..control.slot import Slot
from ..settings import Setting
from .hand import HandSample
from .line import SlotWish

SUPPORT_RANGE = -20.0, 25.0  # [N] ours: what the controller gives
BEYOND_WEIGHT = 2.0  # [N] ours: more would lift an arm that asks for nothing
UNWEIGHED = 15.0  # [N] ours: an outstretched arm of 3.45 kg and 0.65 m presses so at the hand
LOWERED_IN = 4.0  # [s] ours
SPASM = 60.0  # [N] ours: twice what the adaptation's walls give on a straying hand
SPASM_TIME = 0.3  # [s] ours: a stretch reflex lasts longer, a knock does not
LIGHT = 8.0  # [N] ours: a hand on which set points press with more may be an arm that hangs there
PULLS_HARD = "the arm pulls hard"
NO_FEEDBACK = "weight support needs the handle's force fed back: choose mode 3 to 5"
_SETTLED = 1.0  # [s] ours: for a hand that lags behind
_GONE = 0.5  # [N] ours: support that is less is no support
_NS = 1_000_000_000
_LOWERED = Slot(  # ours: as damped as a slot may be, so that an arm which is heavier comes slowly
    duration=LOWERED_IN, back_stiffness=200.0, side_stiffness=200.0, damping=30.0,
    half_width=0.0, end_half_width=0.0, growth=0.0,
)  # fmt: skip


class SupportSettings(NamedTuple):
    """Support by hand."""

    force: Annotated[
        float, Setting("of the arm's weight, asked for by hand, upward on the hand", "N",
                       *SUPPORT_RANGE, live=True)
    ] = 0.0  # ours  # fmt: skip


def refusal(force: float, weight: float, limit: float | None) -> str:
    """Return why a support [N] may not be asked for now, empty if it may.

    weight: of the arm [N], NaN = not weighed; limit: the largest that the controller gives now [N],
    0 = its mode feeds no force back, None = it is silent.
    """
    if force == 0.0:
        return ""
    if limit is None:
        return "weight support needs the vertical controller, which is silent"
    if limit <= 0.0:
        return NO_FEEDBACK
    if abs(force) > limit:
        return (
            f"without torque this drive coasts and the arm falls: at most {limit:g} N of support, "
            "or set its stop_reaction to brake"
        )
    if math.isnan(weight) and force > UNWEIGHED:
        return f"the arm was not weighed: at most {UNWEIGHED:g} N of support"
    if force > weight + BEYOND_WEIGHT:
        return (
            f"the arm weighs {weight:.1f} N: at most {weight + BEYOND_WEIGHT:.1f} N of support, "
            "as more would lift it"
        )
    return ""


class Fade(NamedTuple):
    """Changes the share between circuits, by success: the share of reached trials of a circuit."""

    to: Annotated[float, Setting("share of the weight to which it goes", "", -1.0, 1.0)]
    step: Annotated[float, Setting("of the share after a circuit", "", 0.01, 1.0)]
    after: Annotated[float, Setting("success from which it goes on", "", 0.0, 1.0)]
    back: Annotated[float, Setting("success below which it goes back", "", 0.0, 1.0)]


class BlockSupport(NamedTuple):
    """Support in a block: share of the arm's weight, or force; a share may fade."""

    share: Annotated[float | None, Setting("of the arm's weight", "", -1.0, 1.0)] = None
    force: Annotated[float | None, Setting("in place of a share", "N", *SUPPORT_RANGE)] = None
    fade: Fade | None = None

    def flaw(self) -> str:
        """Return what does not fit together, empty if all does."""
        if (self.share is None) is (self.force is None):
            return "either share or force is wanted"
        if self.fade is not None and self.share is None:
            return "fade: only a share fades, no force"
        if self.fade is not None and self.fade.back >= self.fade.after:
            return f"fade.back = {self.fade.back:g}: must be less than after = {self.fade.after:g}"
        return ""


class Carried:
    """The support that a block of a session asks for.

    force: [N], NaN = it has no say.
    """

    def __init__(self, block: BlockSupport | None, weight: float):
        """weight: of the arm [N], NaN = not weighed."""
        self._weight = weight
        self._block = block or BlockSupport()
        self._share = math.nan if self._block.share is None else self._block.share
        self._fade = self._block.fade
        self._by_hand: tuple[float, float] | None = None
        self.force = self._of_share if self._block.force is None else self._block.force

    @property
    def _of_share(self) -> float:
        lowest, highest = SUPPORT_RANGE
        return clamp(self._share * self._weight, lowest, highest)  # NaN stays NaN

    def set_by_hand(self, force: float) -> None:
        """End the fade: the support is by hand from now on, `force` [N]."""
        if self._fade is not None or self._by_hand is not None:
            self._by_hand = (self._by_hand[0] if self._by_hand else self.force), force
        self._fade, self.force = None, force

    def judge(self, reached: Sequence[bool]) -> tuple[float, float, str] | None:
        """Return the support before and after a circuit [N], and why; None if it does not fade."""
        if self._by_hand is not None:
            (before, after), self._by_hand = self._by_hand, None
            return before, after, "support by hand from now on"
        if self._fade is None:
            return None
        fade, start, success = self._fade, self._block.share or 0.0, mean(reached)
        goal = fade.to if success >= fade.after else start if success < fade.back else self._share
        share, before = self._share, self.force
        self._share = slew(share, goal, fade.step)
        self.force = self._of_share
        way = f"{share:.0%} to {self._share:.0%}" if self._share != share else f"still {share:.0%}"
        why = f"{sum(reached)} of {len(reached)} were reached"
        return before, self.force, f"support {way} of the weight, as {why}"


def block_refusal(block: BlockSupport | None, weight: float, limit: float | None) -> str:
    """Return why a block's support may not be asked for now, empty if it may; as in `refusal`."""
    if block is None:
        return ""
    if block.share is not None and math.isnan(weight):
        return "this protocol carries a share of the arm's weight: weigh the arm first"
    return refusal(Carried(block, weight).force, weight, limit)


class Support:
    """What the arm is carried with, over sessions, pauses and games.

    weight: of the arm [N], NaN = not weighed. limit, in_use: of the controller [N], None and NaN
    while it is silent. lowering: the slot that leads the arm down, None without.
    """

    def __init__(self) -> None:
        self.weight = self.in_use = math.nan
        self.limit: float | None = None
        self.lowering: SlotWish | None = None
        self._force = 0.0
        self._lowered_from = 0.0

    @property
    def force(self) -> float:
        """Return what is asked for now [N], never beyond the arm's weight."""
        most = UNWEIGHED if math.isnan(self.weight) else self.weight + BEYOND_WEIGHT
        return min(self._force, most)

    def refusal(self, force: float) -> str:
        """Return why a support [N] may not be asked for now, empty if it may."""
        return refusal(force, self.weight, self.limit)

    def leaves(self, sample: HandSample) -> float:
        """Return what presses on the hand beside the support [N], NaN if that is not known."""
        fx, fy, fz = sample.force
        return math.hypot(fx, fy, fz + self.in_use)

    def ask(self, force: float) -> None:
        """Ask for a support [N]; it ends a lowering."""
        self._force, self.lowering, self._lowered_from = force, None, 0.0

    def lower(self, height: float, rest_height: float, now_ns: int) -> None:
        """Begin to lower the hand from its height to where the arm lies [m], at now_ns [ns].

        Its weight still rests on the support, which goes once the arm lies: an arm whose support
        fades in the air falls.
        """
        low = min(height, rest_height)
        slot = _LOWERED._replace(start_x=height, target_x=low)
        self.lowering = SlotWish(vertical=slot, start_ns=now_ns)
        self._lowered_from = self._lowered_from or self._force

    def follow(self, now_ns: int) -> None:
        """Go on with a lowering at now_ns [ns]: the support goes, and then the slot."""
        if self.lowering is None or self.lowering.start_ns is None:
            return
        if now_ns - self.lowering.start_ns >= (LOWERED_IN + _SETTLED) * _NS:
            self._force = 0.0
            if not abs(self.in_use) >= _GONE:
                self.lowering = None

    def stop_lowering(self) -> None:
        """Leave the hand where it is, with the support that there is."""
        self.lowering = None

    def carry_on(self) -> None:
        """Carry the arm as before it was lowered: its session goes on."""
        self.ask(self._lowered_from or self._force)


class Spasm:
    """Notices an arm that pulls hard for a while."""

    def __init__(self) -> None:
        self._since_ns: int | None = None

    def notices(self, sample: HandSample) -> bool:
        """Return whether the arm has pulled with more than `SPASM` for `SPASM_TIME`."""
        if not math.hypot(*sample.force) > SPASM:
            self._since_ns = None
            return False
        self._since_ns = sample.time_ns if self._since_ns is None else self._since_ns
        return sample.time_ns - self._since_ns >= SPASM_TIME * _NS
