# SPDX-License-Identifier: Apache-2.0
"""A node whose topics are lists: what it publishes can be read, what it hears is put in.

The transport itself is tried in `test_messages_between.py` and by the graphs.
"""

from __future__ import annotations

from collections import defaultdict
from copy import deepcopy
from typing import Any


class Topics:
    """Both ends of a node's topics.

    told: what it has published, heard: what waits for it, both by topic. senders: what counts
    publishers for it.
    """

    def __init__(self, node: Any):
        self.told: dict[str, list] = defaultdict(list)
        self.heard: dict[str, list] = defaultdict(list)
        self.senders: list[Any] = []
        node.outlet, node.new_inbox = self._outlet, lambda: self
        self._counts, node.senders = node.senders, self._counted

    def _outlet(self, kind: type, topic: str, qos: Any, raw: bool = False) -> Any:
        return lambda message: self.told[topic].append(deepcopy(message))

    def subscribe(self, kind: Any, topic: str, qos: Any, wakes: bool = False) -> Any:
        """Return what takes the next message."""
        return lambda early=True: self.heard[topic].pop(0) if self.heard[topic] else None

    def wait(self, until_ns: int) -> None:
        """Do not wait: what comes is there."""

    def _counted(self, *topics: str) -> Any:
        self.senders.append(self._counts(*topics))
        return self.senders[-1]

    def count(self) -> None:
        """Count the publishers now, as the service thread does ten times a second."""
        for each in self.senders:
            each.count()
