# SPDX-License-Identifier: Apache-2.0
"""Passes the supervisor's permission to the gate of one axis group."""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice

from screw_module_msgs.msg import SafetyState

from screw_module_ros import graph
from screw_module_ros.loop.gated_drives import GatedDrives

from . import qos
from .hot_topics import Inbox
from .module_node import ModuleNode
from .senders import Senders
from .topics import requested


class Permission:
    """Subscribes `safety_state` for the hot loop and counts its senders.

    permitted: reads the axis group's permission from the message.
    """

    def __init__(self, node: ModuleNode, inbox: Inbox, permitted: Callable[[SafetyState], bool]):
        self._permitted = permitted
        self._take = inbox.subscribe(*requested(graph.SAFETY_STATE, qos.PERMISSION))
        self._senders = Senders(node, [graph.SAFETY_STATE])

    @property
    def warning(self) -> str:
        """Message when more than one node publishes safety_state, else empty."""
        return self._senders.warning

    def pass_on(self, drives: GatedDrives, now_ns: int) -> None:
        """Pass new messages to the gate; two senders count as a refusal. now_ns [ns]."""
        for safety in islice(iter(self._take, None), qos.PERMISSION.depth):
            reason = safety.reasons[0] if safety.reasons else ""
            drives.permit(self._permitted(safety), reason, now_ns)
        if self.warning:
            drives.permit(False, self.warning, now_ns)

    def close(self) -> None:
        """Stop counting; the inbox closes the subscription."""
        self._senders.close()
