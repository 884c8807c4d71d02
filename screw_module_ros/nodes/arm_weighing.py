# SPDX-License-Identifier: Apache-2.0
"""The weight of the patients' arms in `therapy_session`: known, or found by weighing."""

from __future__ import annotations

import math

from screw_module_msgs.msg import EndpointState, TherapyState
from screw_module_msgs.srv import StartTherapy

from screw_module_ros.recording.pseudonym import checked_pseudonym
from screw_module_ros.therapy.arm_weights import Arms, ArmWeight, WeightsError, arms_of, keep
from screw_module_ros.therapy.hand import SPACE, hand_sample
from screw_module_ros.therapy.weighing import Weighing, WeighingSettings, places
from screw_module_ros.therapy.wishes import WishLimits

from .support.answering import Done
from .support.node import Node
from .support.place import state_folder


def checked_side(side: str) -> str:
    """Return the side of an arm unchanged. Raises ValueError unless it is one, or empty."""
    if side not in ("", *Arms._fields):
        raise ValueError(f"side = {side[:20]!r}: left or right is wanted, or nothing")
    return side


class ArmWeighing:
    """Carries out the dialogue for the loop's thread, and knows what an arm weighs.

    told: what the dialogue waits for or has found. weight: of the arm of the session or of the
    dialogue, None if it is not known. dialogue: the newest, None before the first.
    """

    def __init__(self, node: Node):
        self._node = node
        self._file = state_folder() / "therapy_session" / "arm_weights.json"
        self.forget()

    def forget(self) -> None:
        """Begin without a dialogue, and without the last patient."""
        self.told, self.weight = "", None
        self.dialogue: Weighing | None = None
        self._arm = "", ""  # pseudonym and side

    @property
    def is_on(self) -> bool:
        """Whether an arm is being weighed."""
        return self.dialogue is not None and self.dialogue.is_on

    @property
    def support(self) -> float:
        """Return what the dialogue asks for [N], NaN without one."""
        return self.dialogue.support if self.dialogue and self.is_on else math.nan

    @property
    def newtons(self) -> float:
        """Return what the arm weighs [N], NaN if it is not known."""
        return self.weight.weight if self.weight else math.nan

    def know(self, patient: str, side: str) -> None:
        """Look up what a patient's arm weighs, and tell when it must be weighed."""
        if self._arm == (patient, side) and self.weight is not None:
            return  # weighed just now; it may not have been kept
        self._arm, self.weight, self.told = (patient, side), None, ""
        try:
            found = getattr(arms_of(self._file, patient), side, None)
        except WeightsError as error:
            self.told = str(error)
            return
        if found is not None and found.is_old(self._now_s):
            days = (self._now_s - found.weighed_s) / 86_400
            self.told = f"weighed {days:.0f} days ago, {found.weight:.1f} N then: weigh again"
        else:
            self.weight = found

    def press(self, request: StartTherapy.Request, limits: WishLimits) -> str:
        """Begin to weigh the arm that the request names, or go on; return what is told then.

        Raises ValueError for a request that names no arm.
        """
        arm = checked_pseudonym(request.patient), checked_side(request.side)
        if not arm[1]:
            raise ValueError("side: left or right is wanted: which arm is it?")
        if self.dialogue is None or not self.is_on:
            settings = self._node.parameters.read(WeighingSettings, "weighing")
            self.dialogue = Weighing(places(limits.ranges()), settings.cradle)
            self._arm, self.weight = arm, None
        elif arm == self._arm:
            self.dialogue.press()
        else:
            return f"the {self._arm[1]} arm of {self._arm[0]} is being weighed: end that first"
        self.told = self.dialogue.told
        return Done(self.told)

    def leave(self, reason: str, at_once: bool) -> None:
        """End a dialogue; at_once: without bringing the arm back."""
        if self.dialogue is not None and self.is_on:
            (self.dialogue.stop if at_once else self.dialogue.leave)(f"not weighed: {reason}")
            self.told = self.dialogue.told

    def take(self, message: EndpointState) -> None:
        """Process a sample of the hand."""
        if self.dialogue is None or not self.is_on:
            return
        self.dialogue.take(hand_sample(message, SPACE))
        self.told, found = self.dialogue.told, self.dialogue.result
        if self.is_on or found is None:
            return
        self.weight = ArmWeight(found.weight, found.spread, self._now_s)
        try:
            keep(self._file, *self._arm, self.weight)
        except WeightsError as error:
            self.told += f"; {error}"

    def fill(self, state: TherapyState) -> None:
        """Write what is known into the state."""
        state.arm = self.told
        state.arm_weight, state.arm_spread = self.weight[:2] if self.weight else (math.nan, 0.0)

    @property
    def _now_s(self) -> int:
        return self._node.clock.stamp_ns() // 1_000_000_000
