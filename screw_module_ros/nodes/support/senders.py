# SPDX-License-Identifier: Apache-2.0
"""How many nodes publish on a topic that must have one sender."""

from __future__ import annotations

from rclpy.node import Node

_LOOK_S = 0.1


class Senders:
    """Counts the publishers of a topic ten times a second, in the executor's thread.

    warning: that there is more than one, else empty. A node that was killed counts until DDS
    forgets it, 20 s later.
    """

    def __init__(self, node: Node, topic: str):
        """Begin to look; `close` ends it."""
        self.warning = ""
        self._node, self._topic = node, topic
        self._timer = node.create_timer(_LOOK_S, self._look)

    def _look(self) -> None:
        count = self._node.count_publishers(self._topic)
        told = f"{count} nodes publish {self._topic}: one is allowed"
        self.warning = told if count > 1 else ""

    def close(self) -> None:
        """Look no more."""
        self._node.destroy_timer(self._timer)
