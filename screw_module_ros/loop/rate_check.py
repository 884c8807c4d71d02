# SPDX-License-Identifier: Apache-2.0
"""Checks that a stream of numbered samples has this node's rate.

The rate is a parameter of each node. If the rates differ, filters, limits in periods and deadlines
use a wrong period, and the only symptom may be late samples.
"""

from __future__ import annotations

from ..samples import sequence_gap

_PAIRS = 50  # a late sample must not look like another rate
_NEAR = 10  # largest distance in ticks between two samples of one sender
_TOLERANCE = 0.1


class RateCheck:
    """Compares the ticks of one stream with a period.

    wrong: a message that names both rates, empty while they agree or too few samples came.
    """

    def __init__(self, sender: str, period_ns: int):
        """Start with the sender's name and this node's period [ns]."""
        self.wrong = ""
        self._sender = sender
        self._period_ns = period_ns
        self._first: tuple[int, int] | None = None
        self._last = 0
        self._pairs = self._ticks = 0

    def note(self, sequence: int, monotonic_ns: int) -> None:
        """Process tick number and acquisition time [ns] of a sample."""
        ticks = sequence_gap(self._last, sequence) + 1
        self._last = sequence
        if self._first is None or not 0 < ticks <= _NEAR:
            self._first = (sequence, monotonic_ns)
            self._pairs = self._ticks = 0
            return
        self._pairs += 1
        self._ticks += ticks
        if self._pairs == _PAIRS:
            self._judge((monotonic_ns - self._first[1]) / self._ticks)
            self._first = None

    def _judge(self, period_ns: float) -> None:
        self.wrong = ""
        if period_ns > 0 and abs(period_ns / self._period_ns - 1.0) > _TOLERANCE:
            self.wrong = (
                f"{self._sender} ticks at {1e9 / period_ns:.0f} Hz, this node at "
                f"{1e9 / self._period_ns:.0f} Hz: give encoder, force_sensor, "
                "impedance_controller and amplifier one `rate`"
            )
