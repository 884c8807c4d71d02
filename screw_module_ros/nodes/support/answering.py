# SPDX-License-Identifier: Apache-2.0
"""Services that answer with an error instead of ending the node: ours, and rclpy's own.

An exception in a callback leaves the executor's `spin_once` and would end the node. But a parameter
of an unknown type, or a transition that is impossible in the present state, is an error of the
client.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.service import Service

from screw_module_ros.clock import TimeStandsStill
from screw_module_ros.devices.errors import DeviceError

_LONGEST = 300  # characters


class Done(str):
    """Message of a service that succeeded; a plain string is the message of a failure.

    fields: further fields of the response, by name.
    """

    fields: dict[str, Any]

    def __new__(cls, text: str, **fields: Any) -> Done:
        """Make it of a text, and of fields beside `success` and `message`."""
        made = super().__new__(cls, text)
        made.fields = fields
        return made


def carried_out(node: Any, action: Callable, request: Any, name: str, always: bool) -> str:
    """Carry out a request; return the answer, `Done` or the reason of a failure."""
    if not (always or node.active):
        return f"the node is not active: {node.failure or f'it is {node.phase}'}"
    try:
        return action(request) or ""
    except (DeviceError, TimeStandsStill) as error:
        return str(error)
    except Exception as error:
        node.get_logger().error(f"{name}: {type(error).__name__}: {error}")
        return str(error) or type(error).__name__


def answer_always(node: Node) -> None:
    """Make every present service of the node answer, whatever its callback raises."""
    for service in node.services:
        service.callback = _answering(node, service, service.callback)


def _answering(node: Node, service: Service, callback: Callable) -> Callable:
    kind: Any = service.srv_type

    def answer(request: Any, response: Any) -> Any:
        try:
            if kind is SetParameters:  # rclpy sets one after the other, those before an odd one too
                for parameter in request.parameters:
                    Parameter.from_parameter_msg(parameter)
            return callback(request, response)
        except Exception as error:
            reason = f"{type(error).__name__}: {error}"[:_LONGEST]
            node.get_logger().warning(f"{service.srv_name}: a request was refused: {reason}")
            refused = SetParametersResult(successful=False, reason=reason)
            if kind is SetParameters:
                return kind.Response(results=[refused] * len(request.parameters))
            if kind is SetParametersAtomically:
                return kind.Response(result=refused)
            return kind.Response()

    return answer
