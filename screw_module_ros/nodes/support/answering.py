# SPDX-License-Identifier: Apache-2.0
"""Makes rclpy's own services of each node answer with an error instead of ending the node.

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

_LONGEST = 300  # characters


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
