# SPDX-License-Identifier: Apache-2.0
"""Waiting by wall clock for processes and the middleware, while simulated time hardly moves.

How long they take depends on the machine; what the robot's guards do meanwhile must not.
"""

from __future__ import annotations

from collections.abc import Callable

from screw_module_ros.clock import Clock, WallClock
from screw_module_ros.lockstep.page import alive

_WALL = WallClock()
_POLL_NS = 20_000_000
_STEP_S = 0.0005
"""Simulated time at each look: this client is not given up, and 1 s of wall clock costs 25 ms."""


def creep_until(clock: Clock, condition: Callable[[], object], seconds: float) -> bool:
    """Wait until `condition()`, for `seconds` of wall clock at most; return whether it came true.

    clock: of a client that takes part in simulated time.
    """
    end_ns = _WALL.now_ns() + round(seconds * 1e9)
    while not condition():
        if _WALL.now_ns() > end_ns:
            return False
        _WALL.sleep_until(_WALL.now_ns() + _POLL_NS)
        if alive(clock.page.conductor):
            clock.sleep(_STEP_S)
    return True
