# SPDX-License-Identifier: Apache-2.0
"""Feedback of a running experiment: progress, remaining time, current step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from screw_module_ros.clock import Clock, WallClock

_EVERY_S = 0.2
_GOOD_S = 10.0


class Feedback:
    """Publishes feedback of one goal; `watch` is called each time and may raise to end the goal.

    clock: for the remaining time; by default wall clock, also in simulated time.
    """

    def __init__(
        self,
        goal: Any,
        kind: type,
        watch: Callable[[], None],
        clock: Clock | None = None,
    ):
        self._goal, self._message, self._watch = goal, kind(), watch
        self._clock = clock or WallClock()
        self._due = 0.0
        self._first: tuple[float, float] | None = None  # time and seconds of excitation done then

    def say(self, doing: str) -> None:
        """Publish the current step at once."""
        self._message.doing = doing
        self._goal.publish_feedback(self._message)

    def progress(self, experiment: str, done: float, total: float) -> None:
        """Publish the progress; done, total: seconds of excitation, from `Lab`."""
        self._watch()
        now = self._clock.now_ns() * 1e-9
        if self._first is None or done < self._first[1]:
            self._first = (now, done)
        self._message.progress = min(done / total, 1.0) if total > 0.0 else 1.0
        self._message.remaining = self._remaining(now, done, total)
        if now >= self._due:
            self._due = now + _EVERY_S
            self._goal.publish_feedback(self._message)

    def _remaining(self, now: float, done: float, total: float) -> float:
        """Return the estimated time [s]: remaining excitation times the pace so far.

        The pace starts as if `_GOOD_S` had passed in real time, because preparations come first.
        """
        begun, before = self._first
        pace = (now - begun + _GOOD_S) / (done - before + _GOOD_S)
        return (total - done) * max(pace, 1.0)
