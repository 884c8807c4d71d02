# SPDX-License-Identifier: Apache-2.0
"""How much a client may send: a bucket of messages that fills again at a steady rate."""

from __future__ import annotations

from .settings import Limits


class Budget:
    """What a client has left."""

    def __init__(self, limits: Limits, now_ns: int):
        self._limits = limits
        self._left = limits.burst
        self._at_ns = now_ns

    def spend(self, now_ns: int) -> bool:
        """Take one message's worth; return whether there was that much."""
        limits = self._limits
        gained = (now_ns - self._at_ns) * 1e-9 * limits.messages
        self._left = min(limits.burst, self._left + gained)
        self._at_ns = now_ns
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True
