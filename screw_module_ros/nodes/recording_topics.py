# SPDX-License-Identifier: Apache-2.0
"""Subscriptions of `session_recorder`: the topics of the graph, and others by name; raw messages.

The topics of the graph are subscribed to at once, with the quality of service of their table; the
others when they have a publisher. The middleware queues arriving messages with their time of
arrival. Every few milliseconds the recorder empties all queues, at a cost of a few microseconds per
message; an executor would need tens of microseconds.
"""

from __future__ import annotations

import struct
import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo

from screw_module_ros import graph
from screw_module_ros.clock import Clock
from screw_module_ros.lockstep.clock import SimulatedClock
from screw_module_ros.lockstep.end import End
from screw_module_ros.recording.bag import Message, Topic
from screw_module_ros.recording.definitions import UNKNOWN, DefinitionError, Definitions
from screw_module_ros.recording.recorder import Recording

from .support.inbox import HotGroup, awaited, never, new_wait_set
from .support.node import Node
from .support.topics import offered

if TYPE_CHECKING:  # a recorder in its own process has no topics within it
    from .support.local_topics import LocalTopics, Queue

LOG = "/rosout"
_BESIDE = (LOG, "/parameter_events")  # topics of every node, so not in the table of the graph
_THINNED = (graph.ENCODER_DECIMATED, graph.FORCE_DECIMATED)  # their content is in the full topics
_DEPTH = 2000  # messages in a queue: two seconds of a 1 kHz topic
_AT_ONCE = 4000  # messages of one topic at most, before the other topics follow
_STAMPS = ("builtin_interfaces/Time", "std_msgs/Header")
_STAMP = struct.Struct("<iI")
_STAMP_AT = 4  # offset of the stamp, after the header of a serialized message


class _Tap:
    """One subscribed topic.

    channel: in the bag, 0 until it has a publisher. queue: of a topic that passes within this
    process, and then it has no subscription.
    """

    def __init__(self, name: str, type_name: str, kind: Any):
        self.name, self.type, self.kind = name, type_name, kind
        self.channel = 0
        self.numbered = True
        first = next(iter(kind.get_fields_and_field_types().values()), "")
        self.is_stamped = first in _STAMPS
        self.end: End | None = None
        self.subscription: Any = None
        self.queue: Queue | None = None


def _resolved(node: Node, name: str) -> str:
    """Return the full name of a topic. Raises ValueError for what is none, such as a pattern."""
    try:
        return node.resolve_topic_name(name)
    except RuntimeError:  # rclpy's RCLError
        raise ValueError(f"topics: {name!r} is no topic name; name each topic by itself") from None


class Taps:
    """Subscriptions for one `recording`. refused: why topics are not recorded, by name."""

    def __init__(self, node: Node, clock: Clock, recording: Recording, extra: Sequence[str] = ()):
        """Subscribe to the topics of the graph; `extra`: names of others."""
        self._node, self._clock, self.recording = node, clock, recording
        self._group = HotGroup()
        self._wait_set = new_wait_set(node, 1)
        self._lock = threading.Lock()  # of declarations
        self._taps: dict[str, _Tap] = {}
        self._extra = dict.fromkeys((*_BESIDE, *(_resolved(node, name) for name in extra)))
        self.refused: dict[str, str] = {}
        for topic in graph.TOPICS.values():
            if topic.name not in _THINNED:
                name = node.resolve_topic_name(topic.name.replace("~", topic.publisher))
                self._extra.pop(name, None)
                _, _, profile = offered(topic.name)
                local = node.local if node.local and node.local.carries(topic.name) else None
                self._try(name, topic.type, profile.reliability, DurabilityPolicy.VOLATILE, local)
        self.look()

    def look(self) -> None:
        """Subscribe to those of the other topics that have come; follow changes of publishers."""
        types = dict(self._node.get_topic_names_and_types()) if self._extra else {}
        for name in [name for name in self._extra if name in types]:
            offers = self._node.get_publishers_info_by_topic(name)
            if offers:
                del self._extra[name]
                self._try(name, types[name][0], *satisfying(name, offers))
        for tap in list(self._taps.values()):
            self._declare(tap)

    def _try(
        self, name: str, kind: str, reliability: ReliabilityPolicy, durability: DurabilityPolicy,
        local: LocalTopics | None = None,
    ) -> None:  # fmt: skip
        """Subscribe to a topic; one that is not possible must not end the recording of others."""
        try:
            tap = _Tap(name, kind, graph.interface_class(kind))
            if local is not None:
                tap.queue = local.read(name, _DEPTH)
                self._taps = {**self._taps, name: tap}
                return
            profile = QoSProfile(depth=_DEPTH, reliability=reliability, durability=durability)
            tap.subscription = self._node.create_subscription(
                tap.kind, name, never, profile, callback_group=self._group, raw=True
            )
            if isinstance(self._clock, SimulatedClock):
                tap.end = self._clock.subscription(name)
        except Exception as error:
            self.refused[name] = str(error) or type(error).__name__
            self._node.get_logger().error(f"{name} is not recorded: {self.refused[name]}")
        else:
            self._taps = {**self._taps, name: tap}  # the loop may be going through the old one

    def _declare(self, tap: _Tap, heard: bool = False) -> None:
        """Add the topic to the bag once it has a publisher or was heard; notice a second one."""
        offers = self._node.get_publishers_info_by_topic(tap.name)
        with self._lock:
            if not tap.channel and (offers or heard):
                tap.channel = self.recording.add_topic(self._topic(tap, offers))
            if len(offers) > 1 and tap.numbered:
                tap.numbered = False
                self.recording.several_publishers(tap.channel)

    def _topic(self, tap: _Tap, offers: list[TopicEndpointInfo]) -> Topic:
        hashes = {str(offer.topic_type_hash) for offer in offers}
        type_hash = hashes.pop() if len(hashes) == 1 else ""
        try:
            definition = Definitions().find(tap.type)
            if definition.type_hash and type_hash and definition.type_hash != type_hash:
                raise DefinitionError(
                    f"its publisher was built with another version of {tap.type}; rebuild both"
                )
        except DefinitionError as error:
            self._node.get_logger().error(f"{tap.name} is recorded without a definition: {error}")
            definition = UNKNOWN
        return Topic(tap.name, tap.type, definition, type_hash, tuple(map(offered_by, offers)))

    def drain(self) -> list[Message]:
        """Take all waiting messages."""
        taken: list[Message] = []
        for tap in self._taps.values():
            taken += self._take(tap) if tap.queue is None else self._take_local(tap, tap.queue)
        return taken

    def _take_local(self, tap: _Tap, queue: Queue) -> list[Any]:
        if queue and not tap.channel:
            self._declare(tap, heard=True)
        taken = []
        while queue:
            _, number, data = queue.popleft()
            stamp_ns = self._stamp(tap, data)
            numbered = number if tap.numbered else 0
            taken.append((tap.channel, stamp_ns, stamp_ns, numbered, data))
        return taken

    def _take(self, tap: _Tap) -> list[Any]:
        """Take the waiting messages of one topic, as plain tuples in the order of `Message`."""
        take, kind, end = tap.subscription.handle.take_message, tap.kind, tap.end
        taken: list[Any] = []
        while len(taken) < _AT_ONCE:
            got = take(kind, True)
            if got is None and end is not None and end.pending:
                # Published and still in transit; it is None when it was lost.
                handle = tap.subscription.handle
                got = awaited(self._wait_set, lambda: take(kind, True), handle, end)
            if got is None:
                break
            if not tap.channel:
                self._declare(tap, heard=True)
            data, info = got
            number = info["publication_sequence_number"] or 0
            received, sent = info["received_timestamp"], info["source_timestamp"]
            if end is not None:
                end.take(number)
                received = sent = self._stamp(tap, data)
            taken.append((tap.channel, received, sent, number if tap.numbered else 0, data))
        return taken

    def _stamp(self, tap: _Tap, data: bytes) -> int:
        """Return the ROS time of a message [ns]: its own stamp, or the present time without one.

        In simulated time a wall-clock stamp, as in rclpy's log messages, counts as no stamp.
        """
        now_ns = self._clock.stamp_ns()
        if tap.is_stamped and data[1] == 1 and len(data) >= _STAMP_AT + _STAMP.size:
            seconds, nanoseconds = _STAMP.unpack_from(data, _STAMP_AT)
            if 0 < seconds <= now_ns // 1_000_000_000:
                return seconds * 1_000_000_000 + nanoseconds
        return now_ns

    def close(self) -> None:
        """Unsubscribe from everything."""
        for tap in self._taps.values():
            if tap.queue is not None:
                assert self._node.local is not None
                self._node.local.leave(tap.name, tap.queue)
                continue
            self._node.destroy_subscription(tap.subscription)
            if tap.end is not None:
                tap.end.close()
        self._taps = {}


def satisfying(
    topic: str, offers: list[TopicEndpointInfo]
) -> tuple[ReliabilityPolicy, DurabilityPolicy]:
    """Return the strictest request that every offer satisfies (as rosbag2 does).

    Of `LOG` only new lines are requested: those of the last seconds name the last bag, and so its
    patient.
    """
    profiles = [offer.qos_profile for offer in offers]
    reliable = all(p.reliability == ReliabilityPolicy.RELIABLE for p in profiles)
    kept = all(p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in profiles)
    return (
        ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        DurabilityPolicy.TRANSIENT_LOCAL if kept and topic != LOG else DurabilityPolicy.VOLATILE,
    )


def offered_by(offer: TopicEndpointInfo) -> dict[str, Any]:
    """Return a publisher's quality of service in rosbag2's terms."""
    profile = offer.qos_profile
    return {
        "history": profile.history.name.lower(),
        "depth": profile.depth,
        "reliability": profile.reliability.name.lower(),
        "durability": profile.durability.name.lower(),
        "deadline": _duration(profile.deadline),
        "lifespan": _duration(profile.lifespan),
        "liveliness": profile.liveliness.name.lower(),
        "liveliness_lease_duration": _duration(profile.liveliness_lease_duration),
        "avoid_ros_namespace_conventions": profile.avoid_ros_namespace_conventions,
    }


def _duration(duration: Duration) -> dict[str, int]:
    seconds, nanoseconds = divmod(duration.nanoseconds, 1_000_000_000)
    return {"sec": seconds, "nsec": nanoseconds}
