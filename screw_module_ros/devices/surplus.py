# SPDX-License-Identifier: Apache-2.0
"""Answers too many: the sign of two devices with one identifier.

CAN lets two devices have one node id and tells nobody. Both obey each command, and of two answers
the first counts, whichever it is of.
"""

from __future__ import annotations

MANY = 50
"""Answers too many that mean a second device: a cable that is disturbed repeats single frames."""
_EASED = 0.25  # share of one answer too many that each answer in time takes off


class Surplus:
    """A leaky bucket of answers that nobody asked for.

    Answers that come late, after their time has counted as missed, are no surplus. A second device
    fills the bucket within 70 of its answers.
    """

    def __init__(self) -> None:
        self._level = 0.0
        self._due = self._missed = 0

    def restart(self, due: int = 0, missed: int = 0) -> None:
        """Empty it; due, missed: the present numbers, see `note`."""
        self._level = 0.0
        self._due, self._missed = due, missed

    def note(self, due: int, missed: int) -> bool:
        """Take in one answer too many; return whether there have been too many of them.

        due, missed: number of answers so far that came when they were due, and of those that did
        not come then.
        """
        came, self._due = due - self._due, due
        lost, self._missed = missed - self._missed, missed
        level = self._level - lost  # what came since makes good for it
        eased = max(0.0, level - _EASED * came) if level > 0.0 else min(0.0, level + came)
        self._level = eased + 1.0
        if self._level < MANY:
            return False
        self._level = 0.0
        return True


class Beats:
    """Heartbeats of one device, of which each period [ns] brings one; two bring a surplus.

    Of two devices one comes when it is due, and one in between. Who beats faster than he was told,
    or whose heartbeats have waited unread, is one device: then none comes when it is due.
    """

    def __init__(self) -> None:
        self.period_ns = 0  # 0: unknown
        self._surplus = Surplus()
        self._due = self._paired = 0

    def note(self, gap_ns: int) -> bool:
        """Take in one that came gap_ns [ns] after the last; return whether two devices beat."""
        if not self.period_ns:
            return False
        if 2 * gap_ns >= self.period_ns:
            self._due += 1
            return False
        if self._due == self._paired:
            return False
        self._paired = self._due
        return self._surplus.note(self._due, 0)
