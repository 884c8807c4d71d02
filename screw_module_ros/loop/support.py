# SPDX-License-Identifier: Apache-2.0
"""The support of the patient's arm in the loop: who asks for it, and for how long that counts."""

from __future__ import annotations

import math

from ..control.support import SupportInput, SupportSettings, SupportState, support_step
from ..safety.latch import Age
from ..samples import ForceReading
from .inputs import RENEWED_NS


class Support:
    """The support of the patient's arm (`control.support`); the loop's thread also calls `ask`.

    settings: may be replaced at any time. state: its memory.
    """

    def __init__(self, settings: SupportSettings):
        self.settings, self.state = settings, SupportState()
        self._wish = math.nan
        self._asked = Age(RENEWED_NS)

    def ask(self, wish: float, now_ns: int) -> None:
        """Ask for a support [N] at now_ns [ns], NaN = for none."""
        self._wish = wish
        self._asked.note(now_ns)

    def idle(self, now_ns: int) -> bool:
        """Return whether nobody asks, none is left, and no hand is off."""
        s = self.state
        return s.force == 0.0 and not s.hand_off and not self._asked.fresh(now_ns)

    def force(
        self, largest: float, acts: bool, velocity: float, hand: ForceReading | None, now_ns: int,
        dt: float,
    ) -> float:  # fmt: skip
        """Return the force on the hand [N], dt [s] after the last.

        largest: that mode and drive allow [N]; acts: torque passes; velocity: of the nut [m/s];
        hand: its newest force.
        """
        wish = self._wish if self._asked.fresh(now_ns) else math.nan
        fx, fy, fz = (hand.fx, hand.fy, hand.fz) if hand else (math.nan,) * 3
        inp = SupportInput(wish, largest, acts, velocity, fz, max(abs(fx), abs(fy)))
        return support_step(self.settings, self.state, inp, dt)
