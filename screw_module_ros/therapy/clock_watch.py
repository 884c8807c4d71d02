# SPDX-License-Identifier: Apache-2.0
"""Notices that the system clock was set while a session ran.

A sample's stamp is the system clock's, which a time server or a user may set. Its tick number
counts periods of the monotonic clock, which nobody sets. So between two samples the stamps must
rise by their ticks times the period. Both come with the samples: a replay decides as the session
did. A stalled process, lost samples or a late arrival change nothing.
"""

from __future__ import annotations

from collections import deque
from statistics import median

from ..samples import sequence_gap
from .hand import HandSample

_LIMIT_S = 0.1
"""Ours: ntpd sets the clock from 0.128 s on, systemd-timesyncd from 0.4 s; both turn smaller errors
into a drift of at most 0.05 %. A stamp is late by less than this, also on a busy machine."""
_STEPS, _LEAST = 25, 5  # from which the period is known, and the fewest
_LONGEST = 2**16  # ticks between two samples; more is no step but another count


class ClockWatch:
    """Compares each sample with the one before."""

    def __init__(self):
        self._last: HandSample | None = None
        self._periods: deque[float] = deque(maxlen=_STEPS)

    def begin(self) -> None:
        """Forget the last sample: the clock may have been set during a pause."""
        self._last = None

    def jump(self, sample: HandSample) -> float:
        """Return by how much the clock was set before this sample [s], 0.0 within the limit."""
        last, self._last = self._last, sample
        if last is None or 0 in (last.sequence, sample.sequence):  # 0: no encoder sample
            return 0.0
        passed = (sample.time_ns - last.time_ns) * 1e-9
        ticks = sequence_gap(last.sequence, sample.sequence) + 1
        if not 0 <= ticks <= _LONGEST:
            return 0.0
        if len(self._periods) >= _LEAST:
            jump = passed - ticks * median(self._periods)
            if abs(jump) > _LIMIT_S:
                return jump
        if ticks > 0:
            self._periods.append(passed / ticks)
        return 0.0
