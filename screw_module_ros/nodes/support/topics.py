# SPDX-License-Identifier: Apache-2.0
"""Topics as ROS objects: type and quality of service, the newest message, who serves and sends.

For `Node.outlet` and `Inbox.subscribe`::

    self.outlet(*offered(graph.JOINT_STATES))
    inbox.subscribe(*requested(graph.SETPOINT))
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from rclpy.client import Client
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo

from screw_module_ros.clock import Clock
from screw_module_ros.graph import TOPICS, interface_class

from .threads import Timers
from .wire import LAYOUTS, Layout


def _keep_last(depth: int, reliability: ReliabilityPolicy) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=reliability,
        durability=DurabilityPolicy.VOLATILE,
    )


SAMPLE = _keep_last(1, ReliabilityPolicy.BEST_EFFORT)
"""Samples at the tick rate: only the newest is useful; the sequence shows a lost one."""

COMMAND = _keep_last(1, ReliabilityPolicy.RELIABLE)
"""Commands and permissions: reliable, and only the newest counts."""

NEWEST = COMMAND
"""For the hot loop's subscriptions of states: a deeper queue would return old ones first."""

STATE = _keep_last(10, ReliabilityPolicy.RELIABLE)
"""States at 50 to 200 Hz: reliable, so that clients with default settings receive them."""

EACH_STATE = _keep_last(200, ReliabilityPolicy.RELIABLE)
"""For a subscription that counts each state: a second at 200 Hz, in which its process may pause."""

PERMISSION = _keep_last(10, ReliabilityPolicy.RELIABLE)
"""For the drives' subscriptions of safety_state: each refusal counts, also an overwritten one."""

_OFFERED = {"sample": SAMPLE, "command": COMMAND, "state": STATE}
_REQUESTED = {"sample": SAMPLE, "command": COMMAND, "state": NEWEST}
_LOOK_S = 0.1
_PREFIX = 12  # bytes of an endpoint's GUID that name its participant (DDSI-RTPS 2.5, 8.2.4)


def offered(topic: str) -> tuple[Any, str, QoSProfile]:
    """Return message class, name and quality of service of a topic, for its publisher."""
    _, type_name, quality, *_ = TOPICS[topic]
    return interface_class(type_name), topic, _OFFERED[quality]


def requested(
    topic: str, profile: QoSProfile | None = None
) -> tuple[Any | Layout, str, QoSProfile]:
    """Return class or record, name and quality of service for a hot loop's subscription.

    profile: replaces the default one, which keeps only the newest message.
    """
    _, type_name, quality, *_ = TOPICS[topic]
    kind = interface_class(type_name)
    return LAYOUTS.get(kind, kind), topic, profile or _REQUESTED[quality]


class Newest:
    """The newest message of one hot subscription.

    take: of `Inbox.subscribe`. max_age_ns: the age up to which it counts as fresh [ns]. The age
    counts from the time it came, however late it is taken, so that neither a sender with a wrong
    clock nor one that died long ago looks fresh.
    """

    def __init__(self, take: Callable[[], Any], max_age_ns: int):
        self._take = take
        self._max_age_ns = max_age_ns
        self.message: Any = None
        self.arrival_ns = 0

    def update(self, now_ns: int) -> Any:
        """Take the waiting message; return it if it is new, else None."""
        message = self._take()
        if message is not None:
            self.message = message
            self.arrival_ns = getattr(self._take, "arrived_ns", now_ns)
        return message

    def forget(self) -> None:
        """Be as before the first message."""
        self.message, self.arrival_ns = None, 0

    def fresh(self, now_ns: int) -> Any:
        """Take the waiting message; return the newest one while it is fresh, else None."""
        self.update(now_ns)
        return None if self.stale(now_ns) else self.message

    def stale(self, now_ns: int) -> bool:
        """Return whether the newest message is too old or missing."""
        return self.message is None or now_ns - self.arrival_ns > self._max_age_ns

    def age_text(self, now_ns: int) -> str:
        """Return the age in seconds as text, `never` when nothing has come."""
        if self.message is None:
            return "never"
        return f"{(now_ns - self.arrival_ns) * 1e-9:.3f}"


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


def too_many_senders(node: Node, topic: str) -> str:
    """Return a message when more than one node publishes a topic of `node`, else empty."""
    count = node.count_publishers(topic)
    if count < 2:
        return ""
    name = node.resolve_topic_name(topic)
    found = node.get_publishers_info_by_topic(name)
    names = sorted({f"{each.node_namespace.rstrip('/')}/{each.node_name}" for each in found})
    return f"{count} nodes publish {topic}: one is allowed ({', '.join(names)})"


class Senders:
    """Counts the publishers of topics that only one node may publish, each 0.1 s.

    Rate and numbers of a second sender's messages may look right, but the middleware knows its
    publishers. It does not report the sender of a message (rclpy's message info has no publisher
    gid), so with two senders neither can be trusted. The service thread counts.

    warnings: messages about topics that more than one node publishes, by topic. A killed node
    counts until the middleware drops it, 20 s later.
    """

    def __init__(self, node: Node, timers: Timers, clock: Clock, topics: Iterable[str]):
        self.warnings: dict[str, str] = {}
        self._node, self._timers, self._topics = node, timers, tuple(topics)
        self._timer = timers.every(clock, _LOOK_S, self.count)

    def count(self) -> str:
        """Count now; return the warning."""
        found = {topic: too_many_senders(self._node, topic) for topic in self._topics}
        self.warnings = {topic: text for topic, text in found.items() if text}
        return self.warning

    @property
    def warning(self) -> str:
        """The first message, empty without one."""
        return next(iter(self.warnings.values()), "")

    def close(self) -> None:
        """Stop counting."""
        self._timers.cancel(self._timer)
