# SPDX-License-Identifier: Apache-2.0
"""Support of the arm's weight: how much may be asked for, by hand and in the blocks of a protocol.

A therapist asks for a constant force S on the hand, up positive; `control/support.py` gives it. It
stays at a pause and at the end of a session, until the arm is lowered (`arm.py`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import fmean as mean
from typing import Annotated, NamedTuple

from ..control import support as control
from ..control.limits import clamp, slew
from ..settings import Setting

_GIVEN = control.SupportSettings()
SUPPORT_RANGE = -_GIVEN.down, _GIVEN.up  # [N] what the controller gives
BEYOND_WEIGHT = 2.0  # [N] ours: more would lift an arm that asks for nothing
UNWEIGHED = 15.0  # [N] ours: an outstretched arm of 3.45 kg and 0.65 m presses so at the hand
NO_FEEDBACK = "weight support needs the handle's force fed back: choose mode 3 to 5"


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

    weight: of the arm [N], NaN = not weighed; force [N].
    """

    def __init__(self, block: BlockSupport | None, weight: float, present: float = 0.0):
        """present: asked for until now [N]; a block without support leaves it as it is."""
        self.weight = weight
        self._block = block or BlockSupport(force=present)
        self._share = math.nan if self._block.share is None else self._block.share
        self._fade = self._block.fade
        self._before: float | None = None  # what faded until it was set by hand [N]
        self.force = self._of_share if self._block.force is None else self._block.force

    @property
    def _of_share(self) -> float:
        return clamp(self._share * self.weight, *SUPPORT_RANGE)  # NaN stays NaN

    def set_by_hand(self, force: float) -> None:
        """End the fade: the support is by hand from now on, `force` [N]."""
        if self._fade is not None:
            self._before = self.force
        self._fade, self.force = None, force

    def judge(self, reached: Sequence[bool]) -> tuple[float, float, str] | None:
        """Return the support before and after a circuit [N], and why; None if it does not fade."""
        before, self._before = self._before, None
        if before is not None:
            return before, self.force, "support by hand from now on"
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
