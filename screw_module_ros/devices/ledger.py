# SPDX-License-Identifier: Apache-2.0
"""Which request an answer belongs to, when frames carry no number (TPDOs, ATI sensor).

A device answers in order, so the answers still owed tell a late one from a new one: only the one
that settles the debt is new. Where a tick ends with an answer in hand and one still owed, nobody
can say whether one was lost or all run late; then no request is made until a tick passes in
silence, and what did not come by then was lost. A value is never taken for a newer one than it is.
"""

from __future__ import annotations

FRESH = 0
LATE = 1
UNEXPECTED = 2


class Ledger:
    """Counts requests and answers of one device; `parts` frames make one answer, in this order."""

    __slots__ = ("_arrived", "_over", "_owed", "listening", "parts")

    def __init__(self, parts: int = 1):
        self.parts = parts
        self.reset()

    def reset(self) -> None:
        """Forget all debts: for a start, when nothing can be under way."""
        self._owed = [0] * self.parts
        self._arrived = 0
        self._over = False
        self.listening = False

    def end_tick(self) -> None:
        """What comes from here to the next `ask` is late: nobody waits for it any more."""
        self._over = True

    def ask(self) -> bool:
        """Begin a tick; return whether a request may be sent in it (no: listen)."""
        owed = any(self._owed)
        if self.listening:
            if not owed or not self._arrived:
                self._owed = [0] * self.parts
                self.listening = False
        elif owed and self._arrived:
            self.listening = True
        self._arrived = 0
        self._over = False
        if self.listening:
            return False
        for part in range(self.parts):
            self._owed[part] += 1
        return True

    def answer(self, part: int = 0) -> int:
        """Note one frame; return FRESH when it belongs to the newest request."""
        self._arrived += 1
        owed = self._owed
        if not owed[part]:
            return UNEXPECTED
        owed[part] -= 1
        for earlier in range(part):
            # Frames of one answer come in order: what should have come before this one was lost.
            owed[earlier] = min(owed[earlier], owed[part])
        return LATE if owed[part] or self.listening or self._over else FRESH
