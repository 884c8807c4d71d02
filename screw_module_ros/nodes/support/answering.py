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

from screw_module_ros.clock import TimeStandsStill
from screw_module_ros.devices.errors import DeviceError

_LONGEST = 300  # characters


class Done(str):
    """Message of a service that succeeded; a plain string is the message of a failure."""

    __slots__ = ()


def offer(
    node: Any, kind: type, name: str, action: Callable[[Any], str], done: str, always: bool
) -> None:
    """Offer a service of a node, see `Node.serve`."""

    def answer(request: Any, response: Any) -> Any:
        with node.service.answering():
            answered = carried_out(node, action, request, name, always)
        response.success = not answered or isinstance(answered, Done)
        response.message = str(answered) or done
        return response

    node.create_service(kind, name, answer)


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
        service.callback = _answering(node, service.srv_type, service.srv_name, service.callback)


def _answering(node: Node, kind: Any, name: str, callback: Callable) -> Callable:
    def refused(error: Exception) -> str:
        reason = f"{type(error).__name__}: {error}"[:_LONGEST]
        node.get_logger().warning(f"{name}: a request was refused: {reason}")
        return reason

    def one(request: Any, response: Any) -> Any:
        try:
            return callback(request, response)
        except Exception as error:
            answer, reason = kind.Response(), refused(error)
            if kind is SetParametersAtomically:
                answer.result = SetParametersResult(successful=False, reason=reason)
            return answer

    def each(request: Any, response: Any) -> Any:
        """Set parameters one by one, so that an invalid one does not affect the others."""
        for parameter in request.parameters:
            try:
                part = callback(kind.Request(parameters=[parameter]), kind.Response())
                response.results.append(part.results[0])
            except Exception as error:
                reason = f"{parameter.name}: {refused(error)}"
                response.results.append(SetParametersResult(successful=False, reason=reason))
        return response

    return each if kind is SetParameters else one
