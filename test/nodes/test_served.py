# SPDX-License-Identifier: Apache-2.0
"""A service is found although the middleware lists an endpoint of a process that has ended."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from rclpy.context import Context
from rclpy.node import Node
from std_srvs.srv import Trigger

from screw_module_ros.nodes.support.topics import is_served

SERVICE = "/robot/enable"


@pytest.fixture
def nodes():
    """Return the nodes `server` and `client`, each a participant of its own."""
    made = {}
    for name in ("server", "client"):
        context = Context()
        context.init()
        made[name] = Node(name, context=context)
    yield SimpleNamespace(**made)
    for node in made.values():
        node.destroy_node()
        node.context.try_shutdown()


class Listed:
    """A node that sees the live endpoints of a service and those that stayed of ended processes.

    Where they are not as many of either kind, the middleware calls no service ready.
    """

    def __init__(self, node: Node, readers: int, writers: int, live: bool):
        self._node, self._live = node, live
        self._stale = {"readers": readers, "writers": writers}

    def _listed(self, kind: str, endpoints: list) -> list:
        ended = [SimpleNamespace(endpoint_gid=[n] * 16) for n in range(self._stale[kind])]
        return ended + (endpoints if self._live else [])

    def get_subscriptions_info_by_topic(self, topic, no_mangle):
        return self._listed("readers", self._node.get_subscriptions_info_by_topic(topic, no_mangle))

    def get_publishers_info_by_topic(self, topic, no_mangle):
        return self._listed("writers", self._node.get_publishers_info_by_topic(topic, no_mangle))


def test_a_service_is_found(nodes, wait_until):
    client = nodes.client.create_client(Trigger, SERVICE)
    assert not is_served(nodes.client, client)
    nodes.server.create_service(Trigger, SERVICE, lambda request, response: response)
    wait_until(lambda: is_served(nodes.client, client))
    assert client.service_is_ready()


@pytest.mark.parametrize(
    ("readers", "writers", "live", "served"),
    [
        (1, 0, True, True),
        (0, 1, True, True),
        (3, 1, True, True),
        (1, 0, False, False),
        (0, 1, False, False),
        (0, 0, False, False),
    ],
)
def test_stale_endpoints_neither_hide_a_service_nor_stand_for_one(
    nodes, wait_until, readers, writers, live, served
):
    client = nodes.client.create_client(Trigger, SERVICE)
    nodes.server.create_service(Trigger, SERVICE, lambda request, response: response)
    wait_until(client.service_is_ready)
    unready = SimpleNamespace(service_is_ready=lambda: False, service_name=client.service_name)
    assert is_served(Listed(nodes.client, readers, writers, live), unready) == served


def test_a_service_that_is_only_half_matched_is_waited_for(nodes, wait_until):
    """As many readers as writers: the middleware knows them all, and says when it is ready."""
    client = nodes.client.create_client(Trigger, SERVICE)
    nodes.server.create_service(Trigger, SERVICE, lambda request, response: response)
    wait_until(client.service_is_ready)
    unready = SimpleNamespace(service_is_ready=lambda: False, service_name=client.service_name)
    assert not is_served(nodes.client, unready)
