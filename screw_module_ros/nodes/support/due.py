# SPDX-License-Identifier: Apache-2.0
"""When the next message of a slower rate is due, at whole multiples of its period."""

from __future__ import annotations


class Due:
    """rate: messages per second [Hz]. The first one is due at once."""

    def __init__(self, rate: float):
        self._period_ns = round(1e9 / rate)
        self._due_ns = 0

    def __call__(self, now_ns: int) -> bool:
        """Return whether a message is due at now_ns [ns]; True counts it as sent."""
        if now_ns < self._due_ns:
            return False
        self._due_ns = (now_ns // self._period_ns + 1) * self._period_ns
        return True
