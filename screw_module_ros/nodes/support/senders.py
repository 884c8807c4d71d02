# SPDX-License-Identifier: Apache-2.0
"""Detects a second publisher of a topic that only one node may publish.

Rate and numbers of a second sender's messages may look right, but the middleware knows its
publishers. It does not report the sender of a message (rclpy's message info has no publisher gid),
so with two senders neither can be trusted.
"""

from __future__ import annotations

from collections.abc import Iterable

from rclpy.node import Node

from .module_node import ModuleNode

_LOOK_S = 0.1


class Senders:
    """Counts the publishers of some topics each 0.1 s, in the executor's thread.

    warning: message when more than one node publishes a topic, else empty. A killed node counts
    until the middleware drops it, 20 s later.
    """

    def __init__(self, node: ModuleNode, topics: Iterable[str]):
        self.warning = ""
        self._node, self._topics = node, tuple(topics)
        self._timer = node.periodic.every(node.clock, _LOOK_S, self._count)

    def _count(self) -> None:
        warnings = (too_many_senders(self._node, topic) for topic in self._topics)
        self.warning = next(filter(None, warnings), "")

    def close(self) -> None:
        """Stop counting."""
        self._node.periodic.cancel(self._timer)


def too_many_senders(node: Node, topic: str) -> str:
    """Return a message when more than one node publishes a topic of `node`, else empty."""
    count = node.count_publishers(topic)
    if count < 2:
        return ""
    name = node.resolve_topic_name(topic)
    found = node.get_publishers_info_by_topic(name)
    names = sorted({f"{each.node_namespace.rstrip('/')}/{each.node_name}" for each in found})
    return f"{count} nodes publish {topic}: one is allowed ({', '.join(names)})"
