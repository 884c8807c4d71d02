# SPDX-License-Identifier: Apache-2.0
"""Waits for a robot, by its clock or by wall clock, and checks its processes meanwhile."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from screw_module_ros.clock import Clock, TimeStandsStill, WallClock
from screw_module_ros.lockstep.end import End

POLL_NS = 20_000_000
_STANDS_NS = 60_000_000_000  # wall clock: a stopped rig, as in a debugger, may continue
_WALL = WallClock()


class RobotError(RuntimeError):
    """A request to the robot failed; the message names the node and quotes it."""


class Waiting:
    """Waits with a clock.

    clock: clock of the waits. watch: called in every wait; may raise to end it.
    """

    def __init__(self, clock: Clock, watch: Callable[[], None]):
        self.clock, self.watch = clock, watch

    def complaints_text(self) -> str:
        """Return the nodes' errors as the end of a sentence, empty without any."""
        return ""

    def pause(self, seconds: float) -> None:
        """Wait, watching."""
        self.pause_until(self.clock.now_ns() + round(seconds * 1e9))

    def pause_until(self, due_ns: int) -> None:
        """Wait until it is `due_ns` by the client's clock [ns], watching."""
        while (now_ns := self.clock.now_ns()) < due_ns:
            self.watch()
            self.sleep_until(min(due_ns, now_ns + POLL_NS))

    def sleep_until(self, until_ns: int, ends: Sequence[End] = ()) -> None:
        """Wait until `until_ns`, or for an answer at `ends`.

        Raises RobotError when simulated time stands because its rig has ended, or for long.
        """
        end_ns = _WALL.now_ns() + _STANDS_NS
        while True:
            try:
                if ends:
                    self.clock.member.wait(until_ns, ends)
                else:
                    self.clock.sleep_until(until_ns)
                return
            except TimeStandsStill as error:
                self.watch()  # a process that has ended gives a better message
                if not self.clock.has_rig or _WALL.now_ns() > end_ns:
                    raise RobotError(str(error)) from None

    def wait_until(self, condition: Callable[[], Any], deadline_s: float, what: str) -> None:
        """Wait for `condition`, watching. Raises RobotError(`what` ...) at the deadline."""
        if not self.met(condition, deadline_s):
            raise RobotError(f"{what} (waited {deadline_s:g} s){self.complaints_text()}")

    def met(self, condition: Callable[[], Any], deadline_s: float) -> bool:
        """Wait for `condition`, watching; return whether it was met before the deadline."""
        end_ns = self.clock.now_ns() + round(deadline_s * 1e9)
        while not condition():
            if self.clock.now_ns() > end_ns:
                return False
            self.pause(POLL_NS * 1e-9)
        return True

    def met_by_wall(self, condition: Callable[[], Any], deadline_s: float) -> bool:
        """Like `met`, by wall clock, for the start of processes."""
        end_ns = _WALL.now_ns() + round(deadline_s * 1e9)
        self.clock.idle()
        while not condition():
            if _WALL.now_ns() > end_ns:
                return False
            self.watch()
            self.clock.idle()  # each time: a condition that calls a service holds time afterwards
            _WALL.sleep_until(_WALL.now_ns() + POLL_NS)
        return True
