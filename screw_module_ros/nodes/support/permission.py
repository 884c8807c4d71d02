# SPDX-License-Identifier: Apache-2.0
"""Passes the supervisor's permission to the gate of one axis group."""

from __future__ import annotations

from itertools import islice

from screw_module_msgs.msg import SafetyState

from screw_module_ros import graph
from screw_module_ros.safety.permit import Permit

from . import qos
from .hot_topics import Inbox
from .module_node import ModuleNode
from .senders import Senders
from .topics import requested

VERTICAL, PLANAR = "vertical_permitted", "planar_permitted"
"""Fields of SafetyState."""


class Permission:
    """Subscribes `safety_state` for the hot loop and counts its senders.

    field: of the message, with the axis group's permission.
    """

    def __init__(self, node: ModuleNode, inbox: Inbox, field: str):
        self._field = field
        self._take = inbox.subscribe(*requested(graph.SAFETY_STATE, qos.PERMISSION))
        self._senders = Senders(node, [graph.SAFETY_STATE])

    @property
    def warning(self) -> str:
        """Message when more than one node publishes safety_state, else empty."""
        return self._senders.warning

    def pass_on(self, permit: Permit, now_ns: int) -> None:
        """Pass new messages to the gate, each with the time at which it came.

        Two senders count as a refusal. now_ns [ns].
        """
        for safety in islice(iter(self._take, None), qos.PERMISSION.depth):
            came_ns = getattr(self._take, "arrived_ns", now_ns)
            permit.supervise(getattr(safety, self._field), why_not(safety, self._field), came_ns)
        if self.warning:
            permit.supervise(False, self.warning, now_ns)

    def close(self) -> None:
        """Stop counting; the inbox closes the subscription."""
        self._senders.close()


def why_not(safety: SafetyState, field: str) -> str:
    """Return why this field withholds the permission of its axes, empty if it does not.

    The message's reasons are those against all motion: the lock and a node that is not required
    leave the other axes alone.
    """
    if getattr(safety, field):
        return ""
    if safety.reasons:
        return safety.reasons[0]
    if safety.vertical_locked and field == VERTICAL:
        return "the vertical axis is locked; pin out, then supervisor/lock_vertical with false"
    return "the supervisor's parameter `required` does not name this node"
