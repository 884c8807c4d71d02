# SPDX-License-Identifier: Apache-2.0
"""Detects a drive whose reported torque (6077) exceeds the command."""

from __future__ import annotations

from collections import deque

_LATE_NS = 5_000_000
_SHORTEST_NS = 20_000_000
_PERIODS = 3
_ROUNDING = 1e-9


class ExcessTorque:
    """Compares the reported torque with the recent commands; all times are passed in.

    Too little torque makes a weak robot; too much, or of the wrong sign, makes a dangerous one. An
    excess above `lasting` fills a leaky bucket, a smaller one empties it. So an excess of `largest`
    is a fault after 20 ms and a smaller one later, and a mean excess above `lasting` always becomes
    a fault, also if it is intermittent.
    """

    def __init__(self, largest: float, lasting: float, period_ns: int):
        """Start without reports: both excesses [Nm], period of the commands [ns]."""
        self._largest, self._lasting = largest, lasting
        patience_ns = max(_SHORTEST_NS, _PERIODS * period_ns)
        self._late_ns = max(_LATE_NS, _PERIODS * period_ns)
        self._longest_ns = period_ns * _PERIODS
        self._bucket = (largest - lasting) * patience_ns * (1.0 - _ROUNDING)
        self._commanded: deque[tuple[int, float]] = deque()
        self.restart()

    def restart(self) -> None:
        """Reset, while the drive is not enabled."""
        self._dose = 0.0
        self._last_ns: int | None = None
        self._commanded.clear()

    def check(self, commanded: float, reported: float, now_ns: int) -> bool:
        """Return whether the excess torque [Nm] has lasted too long at now_ns [ns].

        commanded: torque of the newest command. The drive responds with a delay: each torque
        commanded within the last 5 ms, or three periods if these are longer, counts as correct.
        """
        while self._commanded and now_ns - self._commanded[0][0] > self._late_ns:
            self._commanded.popleft()
        self._commanded.append((now_ns, commanded))
        low = min(0.0, *(torque for _, torque in self._commanded))
        high = max(0.0, *(torque for _, torque in self._commanded))
        excess = max(reported - high, low - reported, 0.0)
        elapsed_ns = 0 if self._last_ns is None else now_ns - self._last_ns
        self._last_ns = now_ns
        fill = (min(excess, self._largest) - self._lasting) * min(elapsed_ns, self._longest_ns)
        self._dose = max(0.0, self._dose + fill)
        return self._dose >= self._bucket
