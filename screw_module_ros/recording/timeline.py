# SPDX-License-Identifier: Apache-2.0
"""Times of reception that go on where the system clock is set while a recording runs.

The middleware dates arrivals by the system clock. A time server or a person may set it; then the
bag would last hours, and a player would mix what came before with what came after. So the log times
of a recording are those of the system clock at its start, continued by the monotonic clock. When
the clock was set, and by how much, is noted in the bag; `publish_time` stays as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timezone
from typing import NamedTuple

from ..clock import Clock
from .mcap_file import Message

SMALLEST_NS = 1_000_000
"""Least step of the system clock that is told from the time between two readings [ns]."""
_QUICK_NS = 100_000
_TRIES = 5


class ClockSet(NamedTuple):
    """The system clock was set: after how long [s] since the start, by how much [s]."""

    after: float
    by: float


class Timeline:
    """Continues log times; for one receiving thread. sets: when the clock was set, in order.

    begun: local time at the start, with its offset from UTC.
    """

    def __init__(self, clock: Clock):
        self._clock = clock
        self._start_ns, self._first, _ = self._read()
        self._looked_ns, self._offset = self._start_ns, self._first
        self._last: dict[int, int] = {}
        self.sets: list[ClockSet] = []
        self.begun = datetime.now(timezone.utc).astimezone()

    def note(self) -> dict[str, str]:
        """Return the note for the bag: beginning (ISO 8601), and when the clock was set."""
        found = {"begun": self.begun.isoformat(timespec="seconds")}
        if self.sets:
            found["set"] = "; ".join(
                f"by {by:+.3f} s, {after:.1f} s after the start" for after, by in self.sets
            )
        return found

    def continued(self, messages: Sequence[Message]) -> Sequence[Message]:
        """Return messages that have just been taken, with log times that no setting moves.

        Nobody sets simulated time.
        """
        if self._clock.simulated:
            return messages
        now_ns, offset, width_ns = self._read()
        before, since_ns = self._offset, self._looked_ns
        self._looked_ns = now_ns
        if abs(offset - before) > max(SMALLEST_NS, width_ns):
            self._offset = offset
            self.sets.append(
                ClockSet((now_ns - self._start_ns) * 1e-9, (offset - before) * 1e-9)
            )
        latest = now_ns + self._first
        found = []
        for message in messages:
            channel, log_time = message[:2]
            time_ns = self._time(log_time, before, since_ns, now_ns) if self.sets else log_time
            # Where the clock was set to and fro between two looks, those before tell the time.
            time_ns = max(min(time_ns, latest), self._last.get(channel, 0))
            self._last[channel] = time_ns
            if time_ns != log_time:
                message = Message(channel, time_ns, *message[2:])
            found.append(message)
        return found

    def _time(self, log_time: int, before: int, since_ns: int, now_ns: int) -> int:
        """Return a log time: by the setting at which it came between the last look and now."""
        came_ns = min(
            (log_time - before, log_time - self._offset),
            key=lambda at_ns: max(since_ns - at_ns, at_ns - now_ns, 0),
        )
        return came_ns + self._first

    def _read(self) -> tuple[int, int, int]:
        """Return the monotonic time, the system clock's minus it, and its uncertainty [ns]."""
        readings = []
        for _ in range(_TRIES):  # this thread may lose the processor between two readings
            begin_ns, stamp_ns, end_ns = (
                self._clock.now_ns(), self._clock.stamp_ns(), self._clock.now_ns()
            )  # fmt: skip
            readings.append((end_ns - begin_ns, begin_ns, stamp_ns))
            if end_ns - begin_ns <= _QUICK_NS:
                break
        width_ns, begin_ns, stamp_ns = min(readings)
        return begin_ns, stamp_ns - begin_ns, width_ns
