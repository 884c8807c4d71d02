# SPDX-License-Identifier: Apache-2.0
"""Finds topics and nodes of other robots: robots of one ROS domain differ by namespace."""

from __future__ import annotations

from rclpy.node import Node

from screw_module_ros.graph import GRAPH

_OURS = frozenset(entry.executable for entry in GRAPH) - {"session_recorder"}
COMMON = (
    "/clock", "/diagnostics", "/parameter_events", "/rosout", "/tf", "/tf_static"
)  # fmt: skip
"""Topics that all robots of a domain share."""


class OtherRobots:
    """The namespaces of other robots, seen from one node."""

    def __init__(self, node: Node):
        """Use the graph of `node`; its namespace is that of its own robot."""
        self._node = node
        self._own = _prefix(node.get_namespace())
        self._others: set[str] = set()
        self.look()

    def look(self) -> None:
        """Update the namespaces from the nodes of the graph."""
        found = {
            _prefix(namespace)
            for name, namespace in self._node.get_node_names_and_namespaces()
            if name in _OURS
        }
        # A namespace around ours holds ours too.
        self._others = {prefix for prefix in found if not self._own.startswith(prefix)}

    def have(self, name: str) -> bool:
        """Return whether a topic or node of this full name belongs to another robot or to none.

        A robot in the root namespace owns every name that is in no other robot's namespace.
        """
        if name.startswith(tuple(self._others)):
            return True
        return not name.startswith(self._own) and name not in COMMON


def _prefix(namespace: str) -> str:
    return f"{namespace.rstrip('/')}/"
