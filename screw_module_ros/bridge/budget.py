# SPDX-License-Identifier: Apache-2.0
"""Rate limit of a client: a token bucket that fills at a constant rate."""

from __future__ import annotations

from .settings import Limits


class Budget:
    """Remaining messages of a client."""

    def __init__(self, limits: Limits, now_ns: int):
        self._limits = limits
        self._left = limits.burst
        self._at_ns = now_ns

    def spend(self, now_ns: int) -> bool:
        """Take one message from the bucket; return whether it held one."""
        limits = self._limits
        gained = (now_ns - self._at_ns) * 1e-9 * limits.messages
        self._left = min(limits.burst, self._left + gained)
        self._at_ns = now_ns
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True
