# SPDX-License-Identifier: Apache-2.0
"""What games, therapy sessions and trials ask of the control loops: a set point, a slot, a lease.

The velocity of a set point expires after `MOVING_NS`. Its position stays valid while it acts; while
it does not, it is forgotten after `KEPT_NS`, or it would pull at the next enabling. A slot that is
not requested again within `RENEWED_NS` fades out, a lease that is not renewed lapses.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..control.excitation import NOTHING, Excitation
from ..control.slot import (
    OPEN,
    Reach,
    Slot,
    SlotInput,
    SlotLimits,
    initial_state,
    kept_within,
    slot_step,
)
from ..safety.latch import Age

MOVING_NS = 200_000_000
RENEWED_NS = 300_000_000
KEPT_NS = 1_000_000_000
_NO_SLOT = Slot()


class SetpointInput:
    """The newest set point of some axes; NaN until one was given."""

    def __init__(self, axes: int):
        self._position = self._none = (math.nan,) * axes
        self._velocity = self._rest = (0.0,) * axes
        self._moving, self._kept = Age(MOVING_NS), Age(KEPT_NS)

    def ask(self, position: tuple[float, ...], velocity: tuple[float, ...], now_ns: int) -> None:
        """Set the set point: position [m], NaN = leave that axis alone, and velocity [m/s]."""
        self._position, self._velocity = position, velocity
        self._moving.note(now_ns)
        self._kept.note(now_ns)

    def at(self, now_ns: int, acts: bool) -> tuple[float, ...]:
        """Return positions [m], then velocities [m/s], which are zero once they expired.

        acts: whether the law may give force. Who gave a set point before may be gone when it does.
        """
        if not acts and not self._kept.fresh(now_ns):
            self._position = self._none
        return (*self._position, *(self._velocity if self._moving.fresh(now_ns) else self._rest))


class Guidance(NamedTuple):
    """The slot's part in one step: force along both axes [N], weight 0 to 1."""

    force_x: float
    force_y: float
    weight: float


NO_GUIDANCE = Guidance(0.0, 0.0, 0.0)


class Guide:
    """The slot of one group of axes; the loop's thread also calls `ask`.

    limits: may be replaced at any time. reach: within which every slot is kept, as set points are.
    """

    def __init__(self, limits: SlotLimits, reach: Reach):
        self.limits = limits
        self.reach = reach
        self._state = initial_state()
        self._slot: Slot | None = None
        self._start_ns = 0
        self._asked = Age(RENEWED_NS)

    def ask(self, slot: Slot | None, start_ns: int, now_ns: int) -> None:
        """Request a slot, None for no slot, with its start time [ns], 0 = open.

        Raises ValueError naming the problem of an invalid slot; the loop then has no slot.
        """
        self._slot = None
        if slot is not None:
            self._slot, self._start_ns = kept_within(slot.validated(), self.reach), start_ns
            self._asked.note(now_ns)

    @property
    def free(self) -> bool:
        """Whether there is no slot, nor one that fades out."""
        return self._slot is None and self._state.weight == 0.0

    def guidance(
        self, x: float, y: float, vx: float, vy: float, now_ns: int, dt: float
    ) -> Guidance:
        """Return the slot's part for the hand at x, y [m], vx, vy [m/s], dt [s] after the last."""
        present = self._slot is not None and self._asked.fresh(now_ns)
        if not present and self._state.weight == 0.0:
            return NO_GUIDANCE
        since = (now_ns - self._start_ns) * 1e-9 if self._start_ns else OPEN
        inp = SlotInput(x, y, vx, vy, present, self._slot or _NO_SLOT, since)
        output, self._state = slot_step(self.limits, self._state, inp, dt)
        return Guidance(output.force_x, output.force_y, output.weight)


class Lease:
    """A trial's hold on the controller, as long as its sender repeats the request.

    request: the newest one. held: from the first request until `end`, so that whoever keeps what
    the trial has changed can put it back. lapsed: no request for `RENEWED_NS`; only `end`, then
    another request, begin anew.
    """

    def __init__(self) -> None:
        self.request = NOTHING
        self.held = self.lapsed = False
        self._asked = Age(RENEWED_NS)

    def renew(self, request: Excitation, now_ns: int) -> None:
        """Take a request, which came at now_ns [ns]; a lapsed lease takes none."""
        if not self.lapsed:
            self.request, self.held = request, True
            self._asked.note(now_ns)

    def check(self, now_ns: int) -> bool:
        """Return whether the lease has lapsed by now_ns [ns]."""
        self.lapsed = self.lapsed or self.held and not self._asked.fresh(now_ns)
        return self.lapsed

    def end(self) -> None:
        """End it: what the trial has changed is put back."""
        self.request, self.held, self.lapsed = NOTHING, False, False
