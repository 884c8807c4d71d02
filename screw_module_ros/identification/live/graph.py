# SPDX-License-Identifier: Apache-2.0
"""Reads and sets lifecycle states of other nodes for an experiment, and reads their parameters."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import GetParameters
from rclpy.parameter import parameter_value_to_python

from screw_module_ros.operator.client import Client, RobotError

UNCONFIGURED, INACTIVE, ACTIVE = (
    State.PRIMARY_STATE_UNCONFIGURED, State.PRIMARY_STATE_INACTIVE, State.PRIMARY_STATE_ACTIVE
)  # fmt: skip
_NAMES = {UNCONFIGURED: "unconfigured", INACTIVE: "inactive", ACTIVE: "active"}
_RISING = {UNCONFIGURED: Transition.TRANSITION_CONFIGURE, INACTIVE: Transition.TRANSITION_ACTIVATE}
_FALLING = {INACTIVE: Transition.TRANSITION_CLEANUP, ACTIVE: Transition.TRANSITION_DEACTIVATE}
_DEADLINE_S = 15.0


def lifecycle_state(client: Client, node: str) -> int:
    """Return the primary lifecycle state of a node. Raises RobotError without an answer."""
    return client.call(GetState, f"{node}/get_state").current_state.id


def bring(client: Client, node: str, wanted: int) -> None:
    """Bring a node to a lifecycle state, step by step from its present state.

    Raises RobotError naming the node, the refused transition and the node's message.
    """
    while (now := lifecycle_state(client, node)) != wanted:
        steps = _RISING if now < wanted else _FALLING
        if now not in steps:
            raise RobotError(f"{node} is in lifecycle state {now}, which has no way back")
        request = ChangeState.Request(transition=Transition(id=steps[now]))
        if not client.call(ChangeState, f"{node}/change_state", request, _DEADLINE_S).success:
            raise RobotError(
                f"{node} stays {_NAMES[now]}, {_NAMES[wanted]} was wanted: {client.said(node)}"
            )


def parameters(client: Client, node: str, names: Iterable[str]) -> dict[str, Any]:
    """Return parameters of a node by name, without undeclared ones."""
    names = list(names)
    request = GetParameters.Request(names=names)
    values = client.call(GetParameters, f"{node}/get_parameters", request).values
    found = zip(names, map(parameter_value_to_python, values), strict=False)
    return {name: value for name, value in found if value is not None}


def topic_of(client: Client, name: str) -> str:
    """Return the full name of a relative one, with the namespace, for a command line."""
    namespace = client.node.get_namespace().rstrip("/")
    return f"{namespace}/{name}"


def disabling(client: Client, drive: str) -> str:
    """Return the command that disables the drives of a node, `amplifier` or `manus`."""
    service = topic_of(client, f"{drive}/enable")
    return f'ros2 service call {service} std_srvs/srv/SetBool "{{data: false}}"'
