# SPDX-License-Identifier: Apache-2.0
"""Checks that the vertical drive gives no torque, for a service of another node."""

from __future__ import annotations

from rclpy.node import Node
from screw_module_msgs.msg import AmplifierState

from screw_module_ros import graph
from screw_module_ros.clock import Clock
from screw_module_ros.devices.errors import DeviceError

from .hot_topics import Inbox
from .single import runs
from .topics import requested

_STATE_S = 0.2
_AMPLIFIER = graph.TOPICS[graph.AMPLIFIER_STATE].publisher


class NotPermitted(DeviceError):
    """The vertical drive gives torque."""


class TorqueOff:
    """Subscribes to the amplifier's state for the service thread. inbox: of the node."""

    def __init__(self, node: Node, inbox: Inbox, clock: Clock):
        self._node, self._clock = node, clock
        self._take_state = inbox.subscribe(*requested(graph.AMPLIFIER_STATE))

    def check(self, why: str) -> None:
        """Raise NotPermitted when the amplifier's next state shows that torque passes or may pass.

        why: the consequence, for the message. A silent amplifier passes no torque, but one that
        the middleware has not discovered yet may: then it raises too.
        """
        self._take_state()  # a waiting message may be old
        states: list[AmplifierState] = []

        def answered() -> bool:
            state = self._take_state()
            states.extend([state] if state is not None else [])
            return bool(states)

        if not self._clock.wait_for(answered, _STATE_S):
            if self._is_undiscovered():
                raise NotPermitted(
                    f"{_AMPLIFIER} runs, but this node has not discovered it yet: try again in a "
                    "moment"
                )
            return
        if states[0].enabled or states[0].state == AmplifierState.OPERATION_ENABLED:
            raise NotPermitted(
                f"the vertical drive is enabled and {why}: disable it first (amplifier/enable)"
            )

    def _is_undiscovered(self) -> bool:
        """Return whether the amplifier runs on this machine and the graph does not show it."""
        namespace = self._node.get_namespace()
        if (_AMPLIFIER, namespace) in self._node.get_node_names_and_namespaces():
            return False
        return runs(f"{namespace.rstrip('/')}/{_AMPLIFIER}")
