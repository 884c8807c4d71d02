# SPDX-License-Identifier: Apache-2.0
"""The plant's time, and its motors as the simulated drives command them.

The time is the wall clock's, or advances in steps, in lock step with the nodes.

With the wall clock the world follows CLOCK_MONOTONIC; after a stall it skips and counts the lost
time instead of integrating a burst. In steps it advances exactly to the conductor's time. A command
then acts a fixed latency after its SYNC, as on a real robot, however long its computation took.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any

from screw_module_ros.plant.world import World

_SHORTEST_NS = 50_000
"""Step of the plant's integration; more frequent calls only cost time."""

_RECENT_NS = 250_000
"""Age up to which readers use the world without an update: all samples of a tick are taken nearly
at once, and an update for each would cost more than the rest of a frame's processing."""

_LONGEST_PERIODS = 5
"""After a longer stall the lost time is skipped."""


class Physics:
    """Advances a world's time.

    stepped: lock step (see above), else wall clock. period_ns: unit of `slipped`. latency_ns: from
    a SYNC to the effect of its command, in lock step.
    """

    def __init__(self, world: World, stepped: bool, period_ns: int, latency_ns: int):
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
        """Advance the world to `now_ns`."""
        if not self.reached_ns:
            self.reached_ns = now_ns
        if self.stepped:
            if self._due or now_ns > self.reached_ns:
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
            if due_ns > self.reached_ns:
                self._go_to(due_ns)
            change()
        if now_ns > self.reached_ns:
            self._go_to(now_ns)

    def _go_to(self, now_ns: int) -> None:
        self.world.advance((now_ns - self.reached_ns) * 1e-9)
        self.reached_ns = now_ns

    def act(self, change: Callable[[], None]) -> None:
        """Apply a change of the commands: now, or in lock step after the latency."""
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
        """Advance the world to `now_ns` for a reader, unless it is recent enough."""
        recent_ns = 1 if self.stepped else _RECENT_NS
        if self._due or now_ns - self.reached_ns >= recent_ns:
            self.advance(now_ns)

    def resume(self) -> None:
        """Continue from the next `advance`, as if no time had passed since the last one."""
        self.reached_ns = 0

    def sync(self, _data: bytes, now_ns: int) -> None:
        """Advance the world to this SYNC, before the devices latch their state."""
        self._synced_ns = now_ns
        self.look(now_ns)


RELEASED = (0.0, False, False)
"""Of a motor: no torque [Nm], not powered, not braked."""


class Axis(ABC):
    """One motor of the plant and its position feedback.

    factor: unit of the world's command per newton metre.
    """

    def __init__(self, physics: Physics, factor: float = 1.0):
        self._physics = physics
        self._world = physics.world
        self._factor = factor
        self._driven = RELEASED

    @abstractmethod
    def position(self) -> int:
        """Return the position feedback [counts]."""

    @abstractmethod
    def torque(self) -> float:
        """Return the torque that really acts on the rotor [Nm]."""

    def drive(self, torque: float, powered: bool, braked: bool) -> None:
        """Set the motor: torque [Nm] while powered; else coasting, or braking when `braked`."""
        driven = (torque * self._factor if powered else 0.0, powered, braked)
        if driven != self._driven:
            self._driven = driven
            self._physics.act(partial(self._set, *driven))

    @abstractmethod
    def _set(self, command: float, powered: bool, braked: bool) -> None:
        """Give the world the motor's command [A or Nm] and its state."""


class VerticalAxis(Axis):
    """The screw's motor behind a current amplifier; factor: amperes per newton metre."""

    def position(self) -> int:
        """Return the motor count."""
        return self._world.encoder_count

    def torque(self) -> float:
        """Return the torque on the rotor [Nm]."""
        return self._world.vertical_torque

    def _set(self, command: float, powered: bool, braked: bool) -> None:
        world = self._world
        world.vertical_command = command
        world.vertical_powered = powered
        world.vertical_braked = braked


class PlanarAxis(Axis):
    """One of the two direct drives of the plane; index 0 = shoulder, 1 = elbow."""

    def __init__(self, physics: Physics, index: int):
        super().__init__(physics)
        self._index = index

    def position(self) -> int:
        """Return the joint's count."""
        return self._world.planar_counts[self._index]

    def torque(self) -> float:
        """Return the torque of the joint's motor [Nm]."""
        return self._world.planar_torque[self._index]

    def _set(self, command: float, powered: bool, braked: bool) -> None:
        world, index = self._world, self._index
        world.planar_command = _with(world.planar_command, index, command)
        world.planar_powered = _with(world.planar_powered, index, powered)
        world.planar_braked = _with(world.planar_braked, index, braked)


def _with(pair: tuple[Any, Any], index: int, value: Any) -> tuple[Any, Any]:
    return (value, pair[1]) if index == 0 else (pair[0], value)
