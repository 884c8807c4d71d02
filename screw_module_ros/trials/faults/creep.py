# SPDX-License-Identifier: Apache-2.0
"""Waits by wall clock for processes and the middleware, while simulated time hardly advances.

Their duration depends on the machine; the reaction of the robot's guards must not.
"""

from __future__ import annotations

from collections.abc import Callable

from screw_module_ros.clock import Clock, WallClock
from screw_module_ros.lockstep.page import alive

_WALL = WallClock()
_POLL_NS = 5_000_000
_STEP_NS, _STEP_S = 100_000_000, 0.0005
"""Each 0.1 s of wall clock the client lets 0.5 ms of simulated time pass, so that the lock step
does not drop it."""


def creep(clock: Clock, seconds: float) -> None:
    """Wait `seconds` of wall clock, for what the middleware of another process does unseen."""
    creep_until(clock, lambda: False, seconds)


def creep_until(clock: Clock, condition: Callable[[], object], seconds: float) -> bool:
    """Wait until `condition()`, at most `seconds` of wall clock; return whether it became true.

    clock: of a client that takes part in simulated time.
    """
    now_ns = _WALL.now_ns()
    end_ns, step_ns = now_ns + round(seconds * 1e9), now_ns + _STEP_NS
    while not condition():
        if now_ns > end_ns:
            return False
        _WALL.sleep_until(now_ns + _POLL_NS)
        now_ns = _WALL.now_ns()
        if now_ns >= step_ns and alive(clock.page.conductor):
            step_ns = now_ns + _STEP_NS
            clock.sleep(_STEP_S)
    return True
