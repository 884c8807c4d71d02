# SPDX-License-Identifier: Apache-2.0
"""A drive that gives more torque than it was asked for: its own answer (6077) tells."""

from __future__ import annotations

_SHORTEST_NS = 20_000_000
_PERIODS = 3


class ExcessTorque:
    """Compares the torque asked for with the torque given; all times are passed in.

    Less than asked for is a weak robot, more or the other way round is a dangerous one.
    """

    def __init__(self, tolerance: float, period_ns: int):
        """Start with nothing seen: tolerance [Nm], period of the commands [ns]."""
        self._tolerance = tolerance
        self._patience_ns = max(_SHORTEST_NS, _PERIODS * period_ns)
        self._since_ns: int | None = None

    def restart(self) -> None:
        """Forget what was seen: the drive is not enabled."""
        self._since_ns = None

    def check(self, asked: float, given: float, now_ns: int) -> bool:
        """Return whether too much torque [Nm] has been there for too long at now_ns [ns]."""
        excess = abs(given - asked) > self._tolerance and (
            abs(given) > abs(asked) or given * asked < 0.0
        )
        if not excess:
            self._since_ns = None
        elif self._since_ns is None:
            self._since_ns = now_ns
        return excess and now_ns - self._since_ns >= self._patience_ns
