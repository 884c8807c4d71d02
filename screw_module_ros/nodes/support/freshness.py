# SPDX-License-Identifier: Apache-2.0
"""A signal is valid only while fresh: the newest message of a topic with its time of arrival."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


class Newest:
    """The newest message of one hot subscription.

    take: of `Inbox.subscribe`. max_age_ns: the age up to which it counts as fresh [ns]. The age
    counts from the time it came, however late it is taken, so that neither a sender with a wrong
    clock nor one that died long ago looks fresh.
    """

    def __init__(self, take: Callable[[], Any], max_age_ns: int):
        self._take = take
        self._max_age_ns = max_age_ns
        self.message: Any = None
        self.arrival_ns = 0

    def update(self, now_ns: int) -> Any:
        """Take the waiting message; return it if it is new, else None."""
        message = self._take()
        if message is not None:
            self.message = message
            self.arrival_ns = getattr(self._take, "arrived_ns", now_ns)
        return message

    def forget(self) -> None:
        """Be as before the first message."""
        self.message, self.arrival_ns = None, 0

    def fresh(self, now_ns: int) -> Any:
        """Take the waiting message; return the newest one while it is fresh, else None."""
        self.update(now_ns)
        return None if self.stale(now_ns) else self.message

    def stale(self, now_ns: int) -> bool:
        """Return whether the newest message is too old or missing."""
        return self.message is None or now_ns - self.arrival_ns > self._max_age_ns

    def age_text(self, now_ns: int) -> str:
        """Return the age in seconds as text, `never` when nothing has come."""
        if self.message is None:
            return "never"
        return f"{(now_ns - self.arrival_ns) * 1e-9:.3f}"
