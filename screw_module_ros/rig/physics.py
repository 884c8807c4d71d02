# SPDX-License-Identifier: Apache-2.0
"""The plant's time: wall clock, or one period per SYNC.

With the wall clock the world follows CLOCK_MONOTONIC; after a stall it gives up the lost time and
counts it instead of integrating a burst. With `sync` it advances one period per SYNC of the bus
that carries the encoder, whatever the machine's load. A command written in answer to a SYNC acts
`latency_ns` after it, as it would on the wall clock, however long the answer took.
"""

from __future__ import annotations

from typing import Protocol

WALL = "wall"
SYNC = "sync"

_SHORTEST_NS = 50_000
"""The plant integrates in steps of this size; asking it more often only costs time."""

_RECENT_NS = 250_000
"""A world no older than this is as good as of now to who only reads it: samples are taken on the
same tick, and bringing it up to date for each costs more than all else that a frame takes."""

_LONGEST_PERIODS = 5
"""A longer stall than this is given up instead of caught up."""


class World(Protocol):
    """What the rig asks of the plant: quantities, units and signs as in `plant.world.World`."""

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

    clock: "wall" or "sync"; period_ns: time per SYNC, and the unit of `slipped` [ns];
    latency_ns: delay from SYNC to the command it led to, with the clock "sync" [ns].
    Raises ValueError for another clock.
    """

    def __init__(self, world: World, clock: str, period_ns: int, latency_ns: int):
        if clock not in (WALL, SYNC):
            raise ValueError(f"clock = {clock!r}: '{WALL}' or '{SYNC}' is wanted")
        self.world = world
        #: whole periods of wall clock given up
        self.slipped = 0
        self._wall = clock == WALL
        self._period_ns = period_ns
        self._latency_ns = min(latency_ns, period_ns)
        #: how far the wall clock's world has come [ns]
        self.reached_ns = 0
        self._begun = False

    def advance(self, now_ns: int) -> None:
        """Bring the world to `now_ns`; nothing to do with the clock "sync"."""
        if not self._wall:
            return
        if not self.reached_ns:
            self.reached_ns = now_ns
        elapsed = now_ns - self.reached_ns
        if elapsed < _SHORTEST_NS:
            return
        self.reached_ns = now_ns
        longest = _LONGEST_PERIODS * self._period_ns
        if elapsed > longest:
            self.slipped += -((longest - elapsed) // self._period_ns)
            elapsed = longest
        self.world.advance(elapsed * 1e-9)

    def look(self, now_ns: int) -> None:
        """Bring the world to `now_ns` for a reader, unless it is recent enough."""
        if now_ns - self.reached_ns >= _RECENT_NS:
            self.advance(now_ns)

    def resume(self) -> None:
        """Go on from the next `advance`, as if no time had passed since the last one."""
        self.reached_ns = 0

    def sync_begin(self, _data: bytes, now_ns: int) -> None:
        """Bring the world to this SYNC, before the devices latch their state."""
        if self._wall:
            self.advance(now_ns)
        elif self._begun and self._latency_ns < self._period_ns:
            self.world.advance((self._period_ns - self._latency_ns) * 1e-9)

    def sync_elsewhere(self, _data: bytes, now_ns: int) -> None:
        """Bring the world up to date for a SYNC on a bus that does not keep its time."""
        self.look(now_ns)

    def sync_end(self, _data: bytes, _now_ns: int) -> None:
        """Go on to the moment at which an answer to this SYNC acts, once it has been answered."""
        self._begun = True
        if not self._wall and self._latency_ns:
            self.world.advance(self._latency_ns * 1e-9)
