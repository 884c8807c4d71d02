# SPDX-License-Identifier: Apache-2.0
"""The plane loop: one period of both planar drives and the law between them.

::

    tick -> SYNC -> both positions -> planar law -> both torques
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from typing import Annotated, NamedTuple

from ..can_io.port import Port
from ..control.timing import DeadlineMeter
from ..devices.errors import DeviceError
from ..settings import Setting
from .planar_axes import PlanarAxes
from .setpoint_input import SetpointInput
from .ticker import Tick, Ticker

_FORCE_AGE_NS = 200_000_000
_UNKNOWN = (math.nan, math.nan)


class PlaneLimits(NamedTuple):
    """Limits that stop the plane, besides those of drives and law."""

    handle_force_limit: Annotated[
        float, Setting("planar handle force that stops the plane", "N", 1.0, 1000.0)
    ] = 150.0
    missed_limit: Annotated[
        int, Setting("deadlines missed in a row that stop the torque", "", 1, 1000)
    ] = 20


class PlaneWires(NamedTuple):
    """The connections to other processes.

    read_inputs: reads set point, handle force and permission at a time [ns], while the drives
    answer. publish_state: called with each tick; it publishes when due.
    """

    read_inputs: Callable[[int], None] = lambda now_ns: None
    publish_state: Callable[[Tick], None] = lambda tick: None


class PlaneLoop:
    """The planar axes on the tick; the caller repeats `step`.

    wanted: the set point, x and y. meter: latency from the tick to the torques. skipped: ticks that
    an overrun skipped.
    """

    def __init__(
        self, axes: PlanarAxes, port: Port, period_ns: int, limits: PlaneLimits, wires: PlaneWires
    ):
        self.axes = axes
        self.wanted = SetpointInput(axes=2)
        self.meter = DeadlineMeter(period_ns)
        self.skipped = 0
        self._port, self._clock = port, port.clock
        self._limits, self._wires = limits, wires
        self._ticker = Ticker(port.clock, period_ns)
        self._hand, self._hand_ns = _UNKNOWN, 0

    def on_force(self, fx: float, fy: float, now_ns: int) -> None:
        """Process the force of the patient on the robot along x and y [N]."""
        self._hand, self._hand_ns = (fx, fy), now_ns

    def step(self) -> None:
        """Do one tick.

        The driver latches errors of the bus; state and diagnostics show them. Gate and writes run
        whatever else fails.
        """
        tick = self._ticker.sleep()
        self.skipped += tick.skipped
        now_ns = tick.monotonic_ns
        with suppress(DeviceError):
            self.axes.request(now_ns)
        self._wires.read_inputs(now_ns)
        hand = self._look_around(now_ns)
        answered = False
        with suppress(DeviceError):
            answered = self._await_drives(now_ns)
        with suppress(DeviceError):
            if answered:
                self.axes.act(self.wanted.at(now_ns), now_ns, hand)
                self.meter.tick(tick.sequence, now_ns, self._clock.now_ns())
            else:
                self.axes.idle(now_ns)
        self._wires.publish_state(tick)

    def _await_drives(self, since_ns: int) -> bool:
        due_ns = self._ticker.due_ns()
        while not self.axes.answered(since_ns):
            if self._clock.now_ns() >= due_ns:
                return False
            self._port.pump(due_ns)
        return True

    def _look_around(self, now_ns: int) -> tuple[float, float]:
        """Stop on a handle force or missed deadlines beyond the limits; return the force [N]."""
        drives, limits = self.axes.drives, self._limits
        fresh = self._hand_ns and now_ns - self._hand_ns <= _FORCE_AGE_NS
        hand = self._hand if fresh else _UNKNOWN
        size = math.hypot(*hand)
        if fresh and not size <= limits.handle_force_limit:
            drives.fault = drives.fault or (
                f"{size:.0f} N on the handle in the plane, more than "
                f"{limits.handle_force_limit:g} N"
            )
        drives.missed(self.meter.missed_in_a_row(now_ns), limits.missed_limit)
        return hand
