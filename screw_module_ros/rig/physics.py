# SPDX-License-Identifier: Apache-2.0
"""The plant's time: wall clock, or steps in lock step with the nodes.

With the wall clock the world follows CLOCK_MONOTONIC; after a stall it gives up the lost time and
counts it instead of integrating a burst. In steps it goes exactly as far as the conductor says, and
a command acts a fixed latency after the SYNC that it answers, as it would on a real robot, however
long the answer took to compute.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Protocol

_SHORTEST_NS = 50_000
"""The plant integrates in steps of this size; asking it more often only costs time."""

_RECENT_NS = 250_000
"""A world no older than this is as good as of now to who only reads it: samples are taken on the
same tick, and bringing it up to date for each costs more than all else that a frame takes."""

_LONGEST_PERIODS = 5
"""A longer stall than this is given up instead of caught up."""


class PlantInterface(Protocol):
    """What the rig asks of the plant: quantities, units, signs as in `plant.world.World`."""

    vertical_command: float
    planar_command: tuple[float, float]
    vertical_powered: bool
    planar_powered: tuple[bool, bool]
    vertical_braked: bool
    planar_braked: tuple[bool, bool]

    def advance(self, dt: float) -> None:
        """Integrate dt [s]."""

    @property
    def encoder_count(self) -> int:
        """Motor-side count, unbounded."""

    @property
    def planar_counts(self) -> tuple[int, int]:
        """Shoulder and elbow counts."""

    @property
    def vertical_torque(self) -> float:
        """Torque on the vertical rotor [Nm]."""

    @property
    def planar_torque(self) -> tuple[float, float]:
        """Torques of shoulder and elbow [Nm]."""

    def wrench(self) -> tuple[float, float, float, float, float, float]:
        """Wrench on the transducer [N, Nm]."""


class Physics:
    """Keeps a world's time.

    stepped: see above, else wall clock. period_ns: the unit of `slipped`. latency_ns: from a SYNC
    to when its answer acts, in steps.
    """

    def __init__(self, world: PlantInterface, stepped: bool, period_ns: int, latency_ns: int):
        self.world = world
        #: whole periods of wall clock given up
        self.slipped = 0
        #: how far the world has come [ns]
        self.reached_ns = 0
        self.stepped = stepped
        self._period_ns = period_ns
        self._latency_ns = latency_ns
        self._due: deque[tuple[int, Callable[[], None]]] = deque()
        self._synced_ns = 0

    def advance(self, now_ns: int) -> None:
        """Bring the world to `now_ns`."""
        if not self.reached_ns:
            self.reached_ns = now_ns
        if self.stepped:
            self._step(now_ns)
            return
        elapsed = now_ns - self.reached_ns
        if elapsed < _SHORTEST_NS:
            return
        self.reached_ns = now_ns
        longest = _LONGEST_PERIODS * self._period_ns
        if elapsed > longest:
            self.slipped += -((longest - elapsed) // self._period_ns)
            elapsed = longest
        self.world.advance(elapsed * 1e-9)

    def _step(self, now_ns: int) -> None:
        while self._due and self._due[0][0] <= now_ns:
            due_ns, change = self._due.popleft()
            self._go_to(due_ns)
            change()
        self._go_to(now_ns)

    def _go_to(self, now_ns: int) -> None:
        if now_ns > self.reached_ns:
            self.world.advance((now_ns - self.reached_ns) * 1e-9)
            self.reached_ns = now_ns

    def act(self, change: Callable[[], None]) -> None:
        """Carry out a change of the commands: now, or in steps when its latency is over."""
        if not self.stepped:
            change()
            return
        due_ns = max(self.reached_ns, self._synced_ns + self._latency_ns)
        if self._due:
            due_ns = max(due_ns, self._due[-1][0])  # commands do not overtake each other
        self._due.append((due_ns, change))
        if due_ns <= self.reached_ns:
            self._step(self.reached_ns)

    def look(self, now_ns: int) -> None:
        """Bring the world to `now_ns` for a reader, unless it is recent enough."""
        if self.stepped or now_ns - self.reached_ns >= _RECENT_NS:
            self.advance(now_ns)

    def resume(self) -> None:
        """Go on from the next `advance`, as if no time had passed since the last one."""
        self.reached_ns = 0

    def sync(self, _data: bytes, now_ns: int) -> None:
        """Bring the world to this SYNC, before the devices latch their state."""
        self._synced_ns = now_ns
        self.look(now_ns)
