# SPDX-License-Identifier: Apache-2.0
"""Matches answers to requests when frames carry no number (TPDOs, ATI sensor).

A device answers in order, so the number of open requests separates a late answer from a new one:
only the answer that closes the last open request is new. When a tick ends with one answer received
and one request still open, either an answer was lost or all answers are late. Then no request is
sent until a tick passes without an answer; answers that have not arrived by then count as lost. So
an old value never passes for a new one.
"""

from __future__ import annotations

FRESH = 0
LATE = 1
UNEXPECTED = 2


class RequestTracker:
    """Counts requests and answers of one device; `parts` frames make one answer, in this order."""

    __slots__ = ("_arrived", "_open", "_over", "listening", "parts")

    def __init__(self, parts: int = 1):
        self.parts = parts
        self.reset()

    def reset(self) -> None:
        """Close all requests; call it at a start, when no answer can be in transit."""
        self._open = [0] * self.parts
        self._arrived = 0
        self._over = False
        self.listening = False

    def end_tick(self) -> None:
        """End the tick: an answer that arrives before the next `ask` is late."""
        self._over = True

    def ask(self) -> bool:
        """Begin a tick; return whether a request may be sent in it (if not, only listen)."""
        open_requests = any(self._open)
        if self.listening:
            if not open_requests or not self._arrived:
                self._open = [0] * self.parts
                self.listening = False
        elif open_requests and self._arrived:
            self.listening = True
        self._arrived = 0
        self._over = False
        if self.listening:
            return False
        for part in range(self.parts):
            self._open[part] += 1
        return True

    def answer(self, part: int = 0) -> int:
        """Process one frame; return FRESH when it belongs to the newest request."""
        self._arrived += 1
        open_requests = self._open
        if not open_requests[part]:
            return UNEXPECTED
        open_requests[part] -= 1
        for earlier in range(part):
            # Frames of one answer come in order: a missing earlier one was lost.
            open_requests[earlier] = min(open_requests[earlier], open_requests[part])
        return LATE if open_requests[part] or self.listening or self._over else FRESH
