# SPDX-License-Identifier: Apache-2.0
"""Periodic and conditional calls of a node's service thread, on our own clocks.

rclpy's timers follow ROS time, which a parameter can stop; guards and diagnostics must not depend
on it. The service thread sleeps in an executor, which sees neither simulated time nor a condition.
So the hot loop asks `is_due` before each step, and triggers the node's guard condition. In
simulated time it also holds the time until the calls are made (`ServingNode.hold_for_calls`).
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from screw_module_ros.clock import Clock, TimeStandsStill

_LONGEST_S = 0.2
"""Longest sleep of the service thread, for a node whose hot loop does not run yet."""
_SHORTEST_S = 1e-4


@dataclass(eq=False)
class Timer:
    """One periodic call; cancelled by `Timers.cancel`."""

    clock: Clock
    period_ns: int
    call: Callable[[], None]
    due_ns: int

    def left_ns(self) -> int:
        """Return the time until the next call [ns]."""
        return self.due_ns - self.clock.now_ns()

    def is_due(self) -> bool:
        """Return whether to call now."""
        return self.clock.now_ns() >= self.due_ns

    def run(self) -> None:
        """Make the call, and plan the next one."""
        self.due_ns += self.period_ns * (-self.left_ns() // self.period_ns + 1)
        self.call()


@dataclass(eq=False)
class Watch:
    """A call while a condition holds; cancelled by `Timers.cancel`."""

    clock: Clock
    is_due: Callable[[], bool]
    run: Callable[[], None]


class Timers:
    """The calls of one node. The service thread calls `run`; any thread may call the rest."""

    def __init__(self) -> None:
        self._all: tuple[Timer | Watch, ...] = ()
        self._timed: tuple[Timer, ...] = ()
        self._seen_by_the_loop: tuple[Timer | Watch, ...] = ()

    def every(self, clock: Clock, period_s: float, call: Callable[[], None]) -> Timer:
        """Call `call` each `period_s` from now on, first after one period."""
        period_ns = round(period_s * 1e9)
        timer = Timer(clock, period_ns, call, clock.now_ns() + period_ns)
        self._replace((*self._all, timer))
        return timer

    def when(self, clock: Clock, condition: Callable[[], bool], call: Callable[[], None]) -> Watch:
        """Call `call` when `condition` holds at the start of a step; the call shall end it."""
        watch = Watch(clock, condition, call)
        self._replace((*self._all, watch))
        return watch

    def cancel(self, unwanted: Timer | Watch) -> None:
        """End the calls of one timer or watch; unknown ones are ignored."""
        self._replace(tuple(each for each in self._all if each is not unwanted))

    def _replace(self, calls: tuple[Timer | Watch, ...]) -> None:
        real = [each for each in calls if isinstance(each, Timer) and not each.clock.simulated]
        self._all, self._timed = calls, tuple(real)
        self._seen_by_the_loop = tuple(each for each in calls if each not in real)

    def is_due(self) -> bool:
        """Return whether the hot loop shall wake the service thread."""
        return any(each.is_due() for each in self._seen_by_the_loop)

    def left_s(self) -> float:
        """Return how long the service thread may sleep without a wake-up [s]."""
        if self.is_due():
            return _SHORTEST_S
        left_s = (each.left_ns() * 1e-9 for each in self._timed)
        return max(_SHORTEST_S, min((_LONGEST_S, *left_s)))

    def due(self) -> list[Timer | Watch]:
        """Return the calls to make now."""
        return [each for each in self._all if each.is_due()]

    def run(self) -> None:
        """Make the calls that are due."""
        for each in self.due():
            with suppress(TimeStandsStill):  # the rig has stopped, so the time is unknown
                each.run()
