# SPDX-License-Identifier: Apache-2.0
"""The slot of a therapy session in the control loops.

A slot that is not requested again within `RENEWED_NS` fades out.
"""

from __future__ import annotations

from typing import NamedTuple

from ..control.slot import OPEN, Slot, SlotInput, SlotLimits, initial_state, slot_step

RENEWED_NS = 300_000_000
_NO_SLOT = Slot()


class Guidance(NamedTuple):
    """The slot's part in one step: force along both axes [N], weight 0 to 1."""

    force_x: float
    force_y: float
    weight: float


class Guide:
    """The slot of one group of axes; the loop's thread also calls `ask`.

    limits: may be replaced at any time.
    """

    def __init__(self, limits: SlotLimits):
        self.limits = limits
        self._state = initial_state()
        self._slot: Slot | None = None
        self._start_ns = 0
        self._asked_ns = 0

    def ask(self, slot: Slot | None, start_ns: int, now_ns: int) -> None:
        """Request a slot, None for no slot, with its start time [ns], 0 = open.

        Raises ValueError naming the problem of an invalid slot; the loop then has no slot.
        """
        self._slot = None
        if slot is not None:
            self._slot, self._start_ns, self._asked_ns = slot.validated(), start_ns, now_ns

    def guidance(
        self, x: float, y: float, vx: float, vy: float, now_ns: int, dt: float
    ) -> Guidance:
        """Return the slot's part for the hand at x, y [m], vx, vy [m/s], dt [s] after the last."""
        present = self._slot is not None and now_ns - self._asked_ns <= RENEWED_NS
        if not present and self._state.weight == 0.0:
            return Guidance(0.0, 0.0, 0.0)
        since = (now_ns - self._start_ns) * 1e-9 if self._start_ns else OPEN
        inp = SlotInput(x, y, vx, vy, present, self._slot or _NO_SLOT, since)
        output, self._state = slot_step(self.limits, self._state, inp, dt)
        return Guidance(output.force_x, output.force_y, output.weight)
