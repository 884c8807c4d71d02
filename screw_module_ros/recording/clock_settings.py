# SPDX-License-Identifier: Apache-2.0
"""Finds in a topic when the system clock was set: stamp and monotonic time of its messages.

A message of the graph that has ticks holds the same moment twice, as a stamp of the system clock
and on a clock that nobody sets. Their difference changes only when somebody sets the clock.
"""

from __future__ import annotations

from .counts import times_of

_LEAST_NS = 100_000_000  # the program may lose the processor between two readings of its clocks
_STEADY_NS = 10_000_000


class ClockSettings:
    """Settings of the clock in one topic.

    steps: by how much it was set [s]. moved_log_times: whether log times followed it. span: first
    and last monotonic time [ns], 0 without any.
    """

    def __init__(self, after_header: bool):
        self.steps: list[float] = []
        self.moved_log_times = False
        self.span = 0, 0
        self._after_header = after_header
        self._offset: int | None = None  # of the stamps
        self._log_offset = 0
        self._candidate: tuple[int, int] | None = None  # offsets of one message alone

    def add(self, data: bytes, log_time: int) -> None:
        """Take a message; log_time [ns]."""
        stamp_ns, at_ns = times_of(data, self._after_header)
        if not (at_ns and stamp_ns):
            return
        first, last = self.span if self.span[0] else (at_ns, at_ns)
        self.span = min(first, at_ns), max(last, at_ns)
        offset, log_offset = stamp_ns - at_ns, log_time - at_ns
        if self._offset is None:
            self._offset, self._log_offset = offset, log_offset
        elif abs(offset - self._offset) < _LEAST_NS:
            self._candidate, self._log_offset = None, log_offset
        elif self._candidate and abs(offset - self._candidate[0]) < _STEADY_NS:
            step, moved = offset - self._offset, self._candidate[1] - self._log_offset
            self.steps.append(step * 1e-9)
            self.moved_log_times |= abs(moved - step) < abs(step) / 2
            self._offset, self._log_offset, self._candidate = offset, log_offset, None
        else:
            self._candidate = offset, log_offset
