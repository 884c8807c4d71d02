# SPDX-License-Identifier: Apache-2.0
"""The service thread of a node, and its periodic and conditional calls on our own clocks.

rclpy's timers follow ROS time, which a parameter can stop; guards and diagnostics must not depend
on it. The service thread sleeps in an executor, which sees neither simulated time nor a condition.
So the hot loop asks before each step whether a call is due, and triggers a guard condition.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import contextmanager, suppress
from dataclasses import dataclass

from rclpy.node import Node

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


class ServiceThread:
    """What one thread does for a node: services, lifecycle, periodic calls.

    In simulated time a request holds time until it is served, and the answer holds time until the
    client has it. A periodic call that is due holds time until it is made.
    """

    def __init__(self, node: Node, timers: Timers):
        self._node, self._timers = node, timers
        self._called = node.create_guard_condition(self.make_calls)
        self._works = threading.RLock()

    def begin(self) -> None:
        """Hold time for requests from now on."""
        self._serving = self._node.clock.serving(self._node.get_fully_qualified_name())

    @contextmanager
    def working(self):
        """Hold time while this thread works, except in its waits, in which requests wait too."""
        with self._works:
            with self._serving.working():
                yield
            self._hold_if_due()

    @contextmanager
    def answering(self):
        """Work for one request, whose client has the answer before time advances."""
        with self._works:
            with self._serving.answering():
                yield
            self._hold_if_due()

    def make_calls(self) -> None:
        """Make the calls that are due."""
        with self.working():  # also without a call: the loop may have held time for one just made
            self._timers.run()

    def wake_if_due(self) -> None:
        """Wake this thread when a call is due, and hold time for it; for the loop's thread."""
        if self._timers.is_due():
            if self._works.acquire(blocking=False):  # else it works, and may need time
                self._hold_if_due()
                self._works.release()
            self.wake()

    def _hold_if_due(self) -> None:
        if self._timers.is_due():
            self._serving.hold()

    def wake(self) -> None:
        """Wake this thread. `Executor.wake` does not: its `spin_once` sleeps again."""
        self._called.trigger()

    def close(self) -> None:
        """Hold time no longer: nothing is served from now on."""
        self._serving.close()
