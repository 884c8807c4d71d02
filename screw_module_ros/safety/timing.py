# SPDX-License-Identifier: Apache-2.0
"""Counters of the timing contract: one call per tick, all times passed in.

The deadline of a command is one period after the acquisition of its sample. A command after its
deadline is late; a tick number without a command is lost. Both count as missed.
"""

from __future__ import annotations

import math
from bisect import bisect_left, insort
from collections import deque
from collections.abc import Sequence

from ..samples import sequence_gap

SUCCESS_WINDOW = 1000  # ticks
LEAST_SUCCESS = 0.99
"""Share of the last 1000 deadlines below which the timing contract counts as broken."""
BIN_NS = 5000
_BINS = 1000  # the last one also counts all longer latencies
_SECOND_NS = 1_000_000_000


class DeadlineMeter:
    """Counts for one stream of ticks.

    samples: ticks with a command; late: those of them after the deadline; lost: missing tick
    numbers; consecutive_missed: deadlines missed in a row up to the last tick; histogram: latencies
    of all samples, counted in bins of BIN_NS. Not thread-safe: one thread calls all methods.
    """

    def __init__(self, period_ns: int):
        """Start at zero; period_ns is the tick period and the deadline [ns]."""
        self.samples = 0
        self.late = 0
        self.lost = 0
        self.consecutive_missed = 0
        self.histogram = empty_histogram()
        self._period_ns = period_ns
        self._sequence: int | None = None
        self._acquired_ns = 0
        self._missed = deque([False] * SUCCESS_WINDOW, SUCCESS_WINDOW)
        self._missed_count = 0
        self._recent: deque[tuple[int, int]] = deque()  # (done [ns], latency [ns]) of one second
        self._sorted: list[int] = []  # the same latencies, in order

    def tick(self, sequence: int, acquired_ns: int, done_ns: int) -> None:
        """Count one tick: its number, time of acquisition and time of the sent command [ns].

        A number that is not newer is ignored. If its acquisition is newer nevertheless, the earlier
        numbers came from a foreign sender, and counting restarts.
        """
        if self._sequence is not None:
            gap = sequence_gap(self._sequence, sequence)
            if gap < 0 and acquired_ns <= self._acquired_ns:
                return
            if gap > 0:
                self.lost += gap
                self.consecutive_missed += gap
                for _ in range(min(gap, SUCCESS_WINDOW)):
                    self._note(True)
        self._sequence = sequence
        self._acquired_ns = acquired_ns
        self.samples += 1
        latency_ns = done_ns - acquired_ns
        missed = latency_ns > self._period_ns
        if missed:
            self.late += 1
            self.consecutive_missed += 1
        else:
            self.consecutive_missed = 0
        self._note(missed)
        note_latency(self.histogram, latency_ns)
        self._recent.append((done_ns, latency_ns))
        insort(self._sorted, latency_ns)
        self._forget(done_ns)

    def missed_in_a_row(self, now_ns: int) -> int:
        """Return the deadlines missed in a row until now_ns [ns], also those of a silent sender."""
        if self._sequence is None:
            return 0
        overdue = (now_ns - self._acquired_ns) // self._period_ns - 1
        return self.consecutive_missed + max(0, overdue)

    def rate(self, now_ns: int) -> float:
        """Return the ticks with a command in the second before now_ns [1/s]."""
        self._forget(now_ns)
        return float(len(self._recent))

    def latency(self, share: float) -> float:
        """Return the quantile `share` of the latencies of the last second [s].

        0.5 gives the median; 0 when there were no ticks.
        """
        if not self._sorted:
            return 0.0
        return self._sorted[min(len(self._sorted) - 1, int(share * len(self._sorted)))] * 1e-9

    @property
    def success_rate(self) -> float:
        """Share of the last 1000 deadlines met; those before the first tick count as met."""
        return 1.0 - self._missed_count / SUCCESS_WINDOW

    def _note(self, missed: bool) -> None:
        self._missed_count += missed - self._missed[0]
        self._missed.append(missed)

    def _forget(self, now_ns: int) -> None:
        """Drop what is older than a second."""
        recent, in_order = self._recent, self._sorted
        while recent and now_ns - recent[0][0] >= _SECOND_NS:
            _, latency_ns = recent.popleft()
            del in_order[bisect_left(in_order, latency_ns)]


def empty_histogram() -> list[int]:
    """Return an empty histogram of latencies."""
    return [0] * _BINS


def note_latency(histogram: list[int], latency_ns: int) -> None:
    """Count one latency [ns]."""
    histogram[min(max(0, latency_ns) // BIN_NS, _BINS - 1)] += 1


def quantile(histogram: Sequence[int], share: float) -> float:
    """Return the quantile `share` of a histogram of latencies [s], as the upper edge of its bin.

    Infinite when it lies in the last bin, 0 for an empty histogram.
    """
    wanted = share * sum(histogram)
    reached = 0
    for number, count in enumerate(histogram):
        reached += count
        if count and reached >= wanted:
            return math.inf if number == len(histogram) - 1 else (number + 1) * BIN_NS * 1e-9
    return 0.0


def histogram_text(histogram: Sequence[int]) -> str:
    """Return the bins that are not empty as `number:count`, separated by blanks."""
    return " ".join(f"{number}:{count}" for number, count in enumerate(histogram) if count)
