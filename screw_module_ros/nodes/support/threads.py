# SPDX-License-Identifier: Apache-2.0
"""The two threads that share a node: its service thread, and the hot loop of its process.

The service thread also makes periodic calls on our own clocks. rclpy's timers follow ROS time,
which a parameter can stop; guards and diagnostics must not depend on it. The thread sleeps in an
executor, which does not see simulated time. So the hot loop asks before each step whether a call is
due, and triggers a guard condition.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.executors import SingleThreadedExecutor

from screw_module_ros.clock import Clock, TimeStandsStill
from screw_module_ros.loop.ticker import BACK_OFF_S

_LONGEST_S = 0.2
"""Longest sleep of the service thread, for a node whose hot loop does not run yet."""
_SHORTEST_S = 1e-4
_START_S = _END_S = 2.0


@dataclass(eq=False)
class Timer:
    """One periodic call; cancelled by `Timers.cancel`."""

    clock: Clock
    period_ns: int
    call: Callable[[], object]
    due_ns: int

    def left_ns(self) -> int:
        """Return the time until the next call [ns]."""
        return self.due_ns - self.clock.now_ns()

    def run(self) -> None:
        """Make the call, and plan the next one."""
        self.due_ns += self.period_ns * (-self.left_ns() // self.period_ns + 1)
        self.call()


class Timers:
    """The calls of one node. The service thread calls `run`; any thread may call the rest."""

    def __init__(self) -> None:
        self._all: tuple[Timer, ...] = ()
        self._simulated: tuple[Timer, ...] = ()  # those that the hot loop asks for in each step

    def every(self, clock: Clock, period_s: float, call: Callable[[], object]) -> Timer:
        """Call `call` each `period_s` from now on, first after one period."""
        period_ns = round(period_s * 1e9)
        timer = Timer(clock, period_ns, call, clock.now_ns() + period_ns)
        self._keep((*self._all, timer))
        return timer

    def cancel(self, unwanted: Timer) -> None:
        """End the calls of one timer; an unknown one is ignored."""
        self._keep(tuple(timer for timer in self._all if timer is not unwanted))

    def _keep(self, timers: tuple[Timer, ...]) -> None:
        self._all = timers
        self._simulated = tuple(timer for timer in timers if timer.clock.simulated)

    def is_due(self) -> bool:
        """Return whether the hot loop shall wake the service thread: a simulated clock cannot."""
        timers = self._simulated
        if not timers:
            return False
        now_ns = timers[0].clock.now_ns()  # there is one simulated time in a process
        for timer in timers:
            if timer.due_ns <= now_ns:
                return True
        return False

    def left_s(self) -> float:
        """Return how long the service thread may sleep without a wake-up [s]."""
        if self.is_due():
            return _SHORTEST_S
        real = (timer for timer in self._all if not timer.clock.simulated)
        return max(_SHORTEST_S, min((_LONGEST_S, *(timer.left_ns() * 1e-9 for timer in real))))

    def due(self) -> list[Timer]:
        """Return the timers whose call is due."""
        return [timer for timer in self._all if timer.left_ns() <= 0]

    def run(self) -> None:
        """Make the calls that are due."""
        for timer in self.due():
            with suppress(TimeStandsStill):  # the rig has stopped, so the time is unknown
                timer.run()


class ServiceThread:
    """The thread that serves a node: services, parameters, lifecycle, periodic calls.

    In simulated time a request holds time until it is served, and the answer holds time until the
    client has it. A periodic call that is due holds time until it is made.

    node: a `node.Node`. failed: whether it ended with an error. Then it ends the process: without
    services and diagnostics the node is useless.
    """

    def __init__(self, node: Any, timers: Timers):
        """Hold time for requests from now on; the thread runs after `start`."""
        self.failed = False
        self._node, self._timers = node, timers
        self._woken = node.create_guard_condition(self.make_calls)
        self._works = threading.RLock()
        self._runs, self._ended = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._serving = node.clock.serving(node.get_fully_qualified_name())

    def start(self, first: Callable[[], None]) -> None:
        """Start the thread, with a first call."""
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._executor.create_task(first)
        self._thread.start()
        self._runs.wait(_START_S)  # from then on the loop may hold simulated time for this thread

    def end(self) -> None:
        """End the thread."""
        self._ended.set()
        self._woken.trigger()
        self._thread.join(timeout=_END_S)
        self._executor.shutdown(timeout_sec=0.0)

    def _run(self) -> None:
        try:
            self.make_calls()
            self._runs.set()
            while not self._ended.is_set():
                self._serve(self._executor)
        except Exception as error:
            self.failed = True
            self._node.get_logger().fatal(
                f"the node ends, what serves its requests failed: {type(error).__name__}: {error}"
            )
        finally:
            self.close()  # the loop may have held time for a call which nobody makes any more
            self._node.stopping.set()

    def _serve(self, executor: SingleThreadedExecutor) -> None:
        # Not `spin`: an executor that is shut down while it spins fails on its own guard condition.
        try:
            executor.spin_once(timeout_sec=self._timers.left_s())
            if self._timers.due():
                self.make_calls()
        except InvalidHandle:  # another thread destroyed what rclpy was about to wait for
            self._ended.wait(BACK_OFF_S)

    def working(self) -> AbstractContextManager[None]:
        """Hold time while this thread works, except in its waits, in which requests wait too."""
        return self._while(self._serving.working())

    def answering(self) -> AbstractContextManager[None]:
        """Work for one request, whose client has the answer before time advances."""
        return self._while(self._serving.answering())

    @contextmanager
    def _while(self, held: AbstractContextManager[None]) -> Iterator[None]:
        with self._works:
            with held:
                yield
            self._hold_if_due()

    def make_calls(self) -> None:
        """Make the calls that are due."""
        with self.working():  # also without a call: the loop may have held time for one just made
            self._timers.run()

    def wake(self) -> None:
        """Wake this thread for a call that is due, and hold time for it; for the loop's thread."""
        if self._works.acquire(blocking=False):  # else it works, and may need time
            self._hold_if_due()
            self._works.release()
        self._woken.trigger()  # not `Executor.wake`: its `spin_once` sleeps again

    def _hold_if_due(self) -> None:
        if self._timers.is_due():
            self._serving.hold()

    def close(self) -> None:
        """Hold time no longer: nothing is served from now on."""
        self._serving.close()


def run_loop(nodes: Sequence[Any], step: Callable[[list[Any]], None]) -> None:
    """Repeat `step` with those of the nodes (`node.Node`) that are active, until they are to stop.

    Before each step their requests are served, here and nowhere else. An error in a step ends the
    process.
    """
    try:
        while not nodes[0].stopping.is_set():
            active = [node for node in nodes if node.enters()]
            try:
                for node in active:
                    node.requests.serve()
                if active:
                    step(active)
            finally:
                for node in active:
                    node.leaves()
            if not active:
                nodes[0].wait_for_activation()
    except TimeStandsStill as error:  # only raised here when the process is to end
        nodes[0].get_logger().warning(str(error))
