# SPDX-License-Identifier: Apache-2.0
"""The first reason stays until it is cleared; a signal is valid only while it is fresh."""

from __future__ import annotations


class Latch:
    """The first reason to stop; later ones usually follow from it. reason: empty without any."""

    __slots__ = ("reason",)

    def __init__(self) -> None:
        self.reason = ""

    def set(self, reason: str) -> None:
        """Keep the reason, unless it is empty or there is one already."""
        self.reason = self.reason or reason

    def clear(self) -> None:
        """Forget the reason."""
        self.reason = ""


class Age:
    """Age of the newest value of a signal; the one rule of freshness. All times in [ns].

    limit_ns: largest age. slack_ns: how far a stamp may lie in the future; one that lies further
    would look fresh for ever. stamp_ns: of the newest value, 0 = none yet.
    """

    __slots__ = ("limit_ns", "slack_ns", "stamp_ns")

    def __init__(self, limit_ns: float, slack_ns: int = 0):
        self.limit_ns, self.slack_ns, self.stamp_ns = int(limit_ns), slack_ns, 0

    def note(self, stamp_ns: int) -> None:
        """Take the stamp of a newer value."""
        self.stamp_ns = stamp_ns

    def fresh(self, now_ns: int) -> bool:
        """Return whether the newest value is neither missing, nor too old, nor of the future."""
        return self.stamp_ns > 0 and -self.slack_ns <= now_ns - self.stamp_ns <= self.limit_ns
