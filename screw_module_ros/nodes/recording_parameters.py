# SPDX-License-Identifier: Apache-2.0
"""Parameters of all nodes at the start of a recording, for the bag.

The recorder asks each node once, without waiting: first for the names, then for the values. Changes
during the recording are in the bag as messages of /parameter_events.
"""

from __future__ import annotations

import json
from functools import partial
from typing import Any

from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future

from screw_module_ros.recording.recorder import NO_ANSWER

_SERVICE = "/get_parameters"
_PATIENCE = 5  # calls of `ask` until a node that does not answer counts as silent


class NodeParameters:
    """Parameters of the nodes of one robot, collected by the executor's thread.

    values: per node, its parameters as JSON with sorted names, null for one that the node does not
    tell; or NO_ANSWER.
    """

    def __init__(self, node: Node):
        """Start without values; `node` asks the nodes of its namespace, those of its robot."""
        self._node = node
        self._prefix = node.get_namespace().rstrip("/")
        self._clients: dict[str, Client] = {}
        self._waited: dict[str, int] = {}
        self.values: dict[str, str] = {}

    def ask(self) -> None:
        """Ask the nodes that have not answered yet; call it about once a second."""
        missing: dict[str, int] = {}
        for service, types in self._node.get_service_names_and_types():
            if not service.endswith(_SERVICE) or "rcl_interfaces/srv/GetParameters" not in types:
                continue
            name = service.removesuffix(_SERVICE)
            if self.values.get(name, NO_ANSWER) != NO_ANSWER or "/_" in name:
                continue
            if name.rpartition("/")[0] != self._prefix:
                continue
            waited = missing[name] = self._waited.get(name, -1) + 1
            if waited >= _PATIENCE:
                self.values.setdefault(name, NO_ANSWER)
            self._ask(name)  # again: an answer is lost if the client is not discovered yet
        self._waited = missing  # a program that comes and goes has not kept silent
        if not missing:
            self.close()  # clients that wait cost the executor time

    def _ask(self, name: str) -> None:
        if name == self._node.get_fully_qualified_name():
            own: dict[str, Any] = self._node.get_parameters_by_prefix("")
            self._keep(name, {key: parameter.value for key, parameter in own.items()})
            return
        client = self._client(ListParameters, f"{name}/list_parameters")
        client.call_async(ListParameters.Request()).add_done_callback(partial(self._named, name))

    def _named(self, name: str, answer: Future) -> None:
        names = sorted(answer.result().result.names)
        client = self._client(GetParameters, f"{name}{_SERVICE}")
        client.call_async(GetParameters.Request(names=names)).add_done_callback(
            partial(self._on_values, name, names)
        )

    def _on_values(self, name: str, names: list[str], answer: Future) -> None:
        try:
            values = [parameter_value_to_python(value) for value in answer.result().values]
        except RuntimeError as error:  # of a type that rclpy does not know
            self._node.get_logger().warning(f"the parameters of {name} are not noted: {error}")
            return
        if len(values) != len(names):  # rclcpp tells none of them where one has no value
            values = [None] * len(names)
        self._keep(name, dict(zip(names, values, strict=True)))

    def _keep(self, name: str, values: dict) -> None:
        plain = {key: list(v) if hasattr(v, "tolist") else v for key, v in values.items()}
        self.values[name] = json.dumps(plain, sort_keys=True, default=str)

    def _client(self, kind: type, service: str) -> Client:
        if service not in self._clients:
            self._clients[service] = self._node.create_client(kind, service)
        return self._clients[service]

    def close(self) -> None:
        """Destroy the clients."""
        for client in self._clients.values():
            self._node.destroy_client(client)
        self._clients = {}
