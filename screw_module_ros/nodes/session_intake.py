# SPDX-License-Identifier: Apache-2.0
"""Subscriptions of `session_recorder`: discovery, matching QoS, raw messages.

The middleware queues arriving messages with their time of arrival. Every few milliseconds the
recorder empties all queues, at a cost of a few microseconds per message; an executor would need
tens of microseconds.
"""

from __future__ import annotations

import fnmatch
import struct
import threading
from typing import Any, NamedTuple

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.topic_endpoint_info import TopicEndpointInfo

from screw_module_ros.clock import Clock
from screw_module_ros.lockstep.end import End
from screw_module_ros.recording import (
    BagError,
    Definition,
    DefinitionError,
    Definitions,
    Message,
    Session,
    Topic,
)

from .session_qos import is_stricter, offered_by, recorded_class, satisfying
from .session_robots import OtherRobots
from .support.inbox import HotGroup, awaited, never

_AT_ONCE = 4000  # messages of one topic at most, before the other topics follow
_STAMPS = ("builtin_interfaces/Time", "std_msgs/Header")
_STAMP = struct.Struct("<iI")
_STAMP_AT = 4  # offset of the stamp, after the header of a serialized message
_NO_DEFINITION = Definition("", "", "")


class Selection(NamedTuple):
    """Topics to record: names or patterns (`/screw/*`) to include and to leave out.

    others: other robots, whose topics are recorded only if named in full; None: record all robots.
    """

    topics: tuple[str, ...] = ("*",)
    exclude: tuple[str, ...] = ()
    hidden: bool = False
    others: OtherRobots | None = None

    def takes(self, name: str) -> bool:
        """Whether the topic `name` is to be recorded."""
        if not self.hidden and any(part.startswith("_") for part in name.split("/")):
            return False
        if name not in self.topics and self.others is not None and self.others.have(name):
            return False
        wanted = any(fnmatch.fnmatchcase(name, pattern) for pattern in self.topics)
        return wanted and not any(fnmatch.fnmatchcase(name, pattern) for pattern in self.exclude)


class _Tap:
    """One subscribed topic."""

    def __init__(self, name: str, kind: type, channel: int):
        self.name = name
        self.kind = kind
        self.channel = channel
        self.numbered = True
        self.newest = b""
        fields = kind.get_fields_and_field_types()
        self.has_calibration = fields.get("calibration") == "string"  # others may mean another
        self.is_stamped = next(iter(fields.values()), "") in _STAMPS
        self.end: End | None = None
        self.subscription: Any = None
        self.request: QoSProfile | None = None


class Intake:
    """Subscriptions to all selected topics, for one session."""

    def __init__(self, node: Node, clock: Clock, selection: Selection, session: Session):
        self._node = node
        self._clock = clock
        self._selection = selection
        self._session = session
        self._definitions = Definitions()
        self._group = HotGroup()
        self._taps: dict[str, _Tap] = {}
        self._taking: list[_Tap] = []
        self._left: list[Message] = []  # taken from a subscription that was replaced
        self._lock = threading.Lock()  # a subscription is taken from, or replaced
        self.refused: dict[str, str] = {}

    def discover(self) -> None:
        """Subscribe to new selected topics; follow changes of their publishers."""
        if self._selection.others is not None:
            self._selection.others.look()
        for name, types in self._node.get_topic_names_and_types():
            if name in self.refused or not self._selection.takes(name):
                continue
            offers = self._node.get_publishers_info_by_topic(name)
            if not offers:
                continue
            try:
                tap = self._taps.get(name) or self._new_tap(name, types, offers)
                self._follow(tap, offers)
            except Exception as error:  # one odd topic must not end the recording of the others
                self._refuse(name, str(error) or type(error).__name__)
        self._taking = list(self._taps.values())

    def _refuse(self, name: str, why: str) -> None:
        self.refused[name] = why
        self._node.get_logger().error(f"{name} is not recorded: {why}")

    def _new_tap(self, name: str, types: list[str], offers: list[TopicEndpointInfo]) -> _Tap:
        if len(types) != 1:
            raise BagError(f"it has several types ({', '.join(types)})")
        kind = recorded_class(types[0])
        channel = self._session.add_topic(self._topic(name, types[0], offers))
        tap = self._taps[name] = _Tap(name, kind, channel)
        return tap

    def _topic(self, name: str, type_name: str, offers: list[TopicEndpointInfo]) -> Topic:
        hashes = {str(offer.topic_type_hash) for offer in offers}
        type_hash = hashes.pop() if len(hashes) == 1 else ""
        try:
            definition = self._definitions.find(type_name)
        except DefinitionError as error:
            self._node.get_logger().warning(f"{name} is recorded without a definition: {error}")
            definition = _NO_DEFINITION
        if "/action/" in type_name:
            type_hash = ""  # readers know these types under another name, with another hash
        elif definition.type_hash and type_hash and definition.type_hash != type_hash:
            self._node.get_logger().error(
                f"{name} is recorded without a definition: its publisher was built with another "
                f"version of {type_name}; rebuild both"
            )
            definition = _NO_DEFINITION
        return Topic(name, type_name, definition, type_hash, [offered_by(o) for o in offers])

    def _follow(self, tap: _Tap, offers: list[TopicEndpointInfo]) -> None:
        if len(offers) > 1 and tap.numbered:
            tap.numbered = False
            self._session.several_publishers(tap.channel)
        request = satisfying(tap.name, offers)
        if tap.request is None:
            self._subscribe(tap, request)
        elif is_stricter(tap.request, request):
            self._node.get_logger().warning(
                f"{tap.name} has a new publisher with weaker quality of service: following it"
            )
            with self._lock:
                self._left += self._take(tap)
                self._node.destroy_subscription(tap.subscription)
                tap.subscription = None
                self._subscribe(tap, request)

    def _subscribe(self, tap: _Tap, request: QoSProfile) -> None:
        tap.request = request
        tap.subscription = self._node.create_subscription(
            tap.kind, tap.name, never, request, callback_group=self._group, raw=True
        )
        if self._clock.simulated and tap.end is None:
            tap.end = self._clock.subscription(tap.name)

    def drain(self) -> list[Message]:
        """Take all waiting messages."""
        with self._lock:
            taken, self._left = self._left, []
            for tap in self._taking:
                if tap.subscription is not None:
                    taken += self._take(tap)
        return taken

    def _take(self, tap: _Tap) -> list[Any]:
        """Take the waiting messages of one topic, as plain tuples in the order of `Message`."""
        take, kind, channel = tap.subscription.handle.take_message, tap.kind, tap.channel
        numbered, end = tap.numbered, tap.end
        taken: list[Any] = []
        while len(taken) < _AT_ONCE:
            got = take(kind, True)
            if got is None and end is not None:
                got = self._awaited(tap)
            if got is None:
                break
            data, info = got
            number = info["publication_sequence_number"] or 0
            received, sent = info["received_timestamp"], info["source_timestamp"]
            if end is not None:
                end.take(number)
                received = sent = self._stamp(tap, data)
            taken.append((channel, received, sent, number if numbered else 0, data))
        if taken and tap.has_calibration:
            tap.newest = taken[-1][4]
        return taken

    def _awaited(self, tap: _Tap) -> Any:
        """Take a published message that is still in transit, None when it was lost."""
        if not tap.end.pending:
            return None
        handle = tap.subscription.handle
        return awaited(
            self._node, lambda: handle.take_message(tap.kind, True), handle, tap.end
        )

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

    def calibrations(self) -> dict[str, str]:
        """Return the newest calibration identity of each topic."""
        found = {}
        for tap in self._taking:
            if tap.newest:
                found[tap.name] = deserialize_message(tap.newest, tap.kind).calibration
        return found

    def close(self) -> None:
        """Unsubscribe from everything."""
        for tap in self._taps.values():
            if tap.subscription is not None:
                self._node.destroy_subscription(tap.subscription)
            if tap.end is not None:
                tap.end.close()
        self._taps, self._taking = {}, []
