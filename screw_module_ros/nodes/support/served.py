# SPDX-License-Identifier: Apache-2.0
"""Whether a service is offered, also where the middleware's list of endpoints is out of date."""

from __future__ import annotations

from rclpy.client import Client
from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo

_PREFIX = 12  # bytes of an endpoint's GUID that name its participant (DDSI-RTPS 2.5, 8.2.4)


def is_served(node: Node, client: Client) -> bool:
    """Return whether a node offers the client's service. node: the client's.

    rmw_fastrtps calls a service ready when as many readers of requests as writers of replies are
    known. An endpoint that is discovered while its process ends can stay in that list, and then
    `service_is_ready` is false for as long as the client's process lives. So where the numbers
    differ, one participant with both is enough.
    """
    if client.service_is_ready():
        return True
    name = client.service_name
    readers = node.get_subscriptions_info_by_topic(f"rq{name}Request", no_mangle=True)
    writers = node.get_publishers_info_by_topic(f"rr{name}Reply", no_mangle=True)
    if len(readers) == len(writers):
        return False
    return not _participants(readers).isdisjoint(_participants(writers))


def _participants(endpoints: list[TopicEndpointInfo]) -> set[bytes]:
    return {bytes(endpoint.endpoint_gid[:_PREFIX]) for endpoint in endpoints}
