# SPDX-License-Identifier: Apache-2.0
"""Timers of a node's service thread, on our own clocks.

rclpy's timers follow ROS time, which a parameter can stop; guards and diagnostics must not depend
on it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from screw_module_ros.clock import Clock, TimeStandsStill

_LONGEST_S = 0.2
"""Longest wall-clock sleep before simulated time is read again, as it has its own speed."""


@dataclass(eq=False)
class Timer:
    """One periodic call; cancelled by `Timers.cancel`."""

    clock: Clock
    period_ns: int
    call: Callable[[], None]
    due_ns: int


class Timers:
    """The timers of one node. The service thread calls `run`; any thread may call the rest."""

    def __init__(self) -> None:
        self._timers: list[Timer] = []

    def every(self, clock: Clock, period_s: float, call: Callable[[], None]) -> Timer:
        """Call `call` each `period_s` from now on, first after one period."""
        period_ns = round(period_s * 1e9)
        timer = Timer(clock, period_ns, call, clock.now_ns() + period_ns)
        self._timers = [*self._timers, timer]
        return timer

    def cancel(self, timer: Timer) -> None:
        """End the calls of one timer; unknown ones are ignored."""
        self._timers = [each for each in self._timers if each is not timer]

    def is_due(self) -> bool:
        """Return whether `run` would call anything."""
        return any(each.clock.now_ns() >= each.due_ns for each in self._timers)

    def left_s(self) -> float:
        """Return how long the service thread may sleep before it checks the timers again [s]."""
        left_ns = [each.due_ns - each.clock.now_ns() for each in self._timers]
        return min(_LONGEST_S, max(1e-4, min(left_ns, default=0) * 1e-9))

    def run(self) -> None:
        """Make the calls that are due."""
        for timer in self._timers:
            now_ns = timer.clock.now_ns()
            if now_ns < timer.due_ns:
                continue
            timer.due_ns += timer.period_ns * ((now_ns - timer.due_ns) // timer.period_ns + 1)
            try:
                with timer.clock.working():
                    timer.call()
            except TimeStandsStill:
                continue  # the rig has stopped, so the time is unknown
