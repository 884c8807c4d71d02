# SPDX-License-Identifier: Apache-2.0
"""Topics and services of the robots, for the clients of the bridge.

The gateway takes no part in simulated time, because a browser must not delay the robot. The node's
loop polls the subscriptions, which hold only the newest message: a topic at 200 Hz costs only as
much as the bridge sends of it. A message is converted to JSON once, for its first client.
"""

from __future__ import annotations

import importlib
import json
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile

from screw_module_ros.bridge.conversion import fill, plain
from screw_module_ros.bridge.rights import (
    ASKED,
    ATTENDANCE,
    ATTENDED,
    HEARD,
    KEPT,
    SENT,
    Rights,
)
from screw_module_ros.clock import WallClock

from .support import topics
from .support.inbox import HotGroup, never
from .support.threads import Timers
from .support.topics import is_served

_OLD_NS = 1_000_000_000  # a state this old says nothing about the robot of now
_MOST_KEPT = 1100  # a session of the clock game has 1024 movements
_CHECK_S = 0.1
_FOUND_NS = 5_000_000_000  # the middleware repeats lost announcements each 3 s
_AT_ONCE = Duration(nanoseconds=5_000_000)  # most acknowledgements come within it


def found_type(name: str) -> type:
    """Return the class of a type, `package/msg/Name`, or `package/Name` of a message."""
    package, _, rest = name.partition("/")
    group, _, kind = rest.rpartition("/")
    return getattr(importlib.import_module(f"{package}.{group or 'msg'}"), kind)


def new_message(name: str) -> Any:
    """Return a message of a type, `package/Name`."""
    return found_type(name)()


class PolledTopic:
    """A polled subscription with its newest message; kept: whether to keep earlier ones (JSON)."""

    def __init__(
        self, node: Node, name: str, kind: str, profile: QoSProfile, group: HotGroup, kept: bool
    ):
        self.kept: deque[str] = deque(maxlen=_MOST_KEPT if kept else 0)
        self.kind = found_type(kind)
        self.subscription = node.create_subscription(
            self.kind, name, never, profile, callback_group=group
        )
        self._newest: tuple[int, Any] | None = None
        self._arrived_ns = 0
        self._text: tuple[int, str] | None = None

    def poll(self) -> None:
        """Take the messages that have arrived."""
        while (taken := self.subscription.handle.take_message(self.kind, False)) is not None:
            count = self._newest[0] if self._newest else 0
            self._newest = (count + 1, taken[0])
            self._arrived_ns = taken[1]["received_timestamp"]  # it may have waited for a client
            if self.kept.maxlen:  # now, as a thousand at once would hold up every client
                self.kept.append(_text(taken[0]))

    def newest(self, stamp_ns: int) -> tuple[int, str] | None:
        """Return the newest message as JSON, with its number from 1; None if it is old.

        stamp_ns: time of the system clock [ns]. A page that connects would take the last message
        of a dead node for news. A message that is kept counts by itself and does not age.
        """
        if not self.kept.maxlen and stamp_ns - self._arrived_ns > _OLD_NS:
            return None
        newest = self._newest
        if newest is not None and (self._text is None or self._text[0] != newest[0]):
            self._text = (newest[0], _text(newest[1]))
        return self._text

    def history(self) -> list[str]:
        """Return the last messages as JSON."""
        return list(self.kept)


def _text(message: Any) -> str:
    return json.dumps(plain(message), allow_nan=False, separators=(",", ":"))


@dataclass
class _Unsent:
    """A call that its node cannot receive yet; due_ns: when it is given up [ns].

    attended: whether the page's attendance has been published ahead of it.
    """

    due_ns: int
    service: str
    send: Callable[[], None]
    answered: Callable[[Any, bool], None]
    attended: bool = False


class BridgeGateway:
    """Topics and services of the robots that `rights` names; see `bridge.client.Gateway`.

    answer_s: time limit of a service call [s].
    """

    def __init__(self, node: Node, rights: Rights, periodic: Timers, answer_s: float):
        self._node, self._answer_ns = node, round(answer_s * 1e9)
        self._clock = WallClock()
        self._polled: dict[str, PolledTopic] = {}
        self._publishers: dict[str, Any] = {}
        self._clients: dict[str, Any] = {}
        self._waiting: dict[Any, tuple[int, Callable[[], None]]] = {}
        self._unsent: list[_Unsent] = []
        self._changing = threading.Lock()
        group = HotGroup()
        for place, kind in rights.places(HEARD):
            kept = place.name in KEPT
            profile = topics.STATE if kept else topics.SAMPLE
            self._polled[place.full] = PolledTopic(node, place.full, kind, profile, group, kept)
        for place, kind in rights.places(SENT):
            self._publishers[place.full] = node.create_publisher(
                found_type(kind), place.full, topics.COMMAND
            )
        for place, kind in rights.places(ASKED):
            self._clients[place.full] = node.create_client(found_type(kind), place.full)
        self._attendance = {
            place.full: self._publishers[place._replace(name=ATTENDANCE).full]
            for place, _ in rights.places(ASKED)
            if place.name in ATTENDED
        }
        self._periodic = periodic
        self._timer = periodic.every(self._clock, _CHECK_S, self._check_calls)

    def close(self) -> None:
        """Destroy topics and clients."""
        self._periodic.cancel(self._timer)
        for topic in self._polled.values():
            self._node.destroy_subscription(topic.subscription)
        for publisher in self._publishers.values():
            self._node.destroy_publisher(publisher)
        for client in self._clients.values():
            self._node.destroy_client(client)

    def poll(self, anybody: bool) -> None:
        """Take new messages, from the node's loop; without `anybody` only those of kept topics."""
        for topic in self._polled.values():
            if anybody or topic.kept.maxlen:
                topic.poll()

    # Gateway: called from the server's thread ------------------------------------------------

    def newest(self, topic: str) -> tuple[int, str] | None:
        """Return a topic's newest message as JSON, with its number."""
        return self._polled[topic].newest(self._clock.stamp_ns())

    def history(self, topic: str) -> list[str]:
        """Return the last messages of a topic that is kept, as JSON, oldest first."""
        return self._polled[topic].history()

    def publish(self, topic: str, content: dict) -> None:
        """Publish a message. Raises ConversionError."""
        publisher = self._publishers[topic]
        message = fill(publisher.msg_type(), content, new_message)
        publisher.publish(message)

    def call(self, service: str, arguments: dict, answered: Callable[[Any, bool], None]) -> None:
        """Call a service. Raises ConversionError."""
        client = self._clients[service]
        request = fill(client.srv_type.Request(), arguments, new_message)
        send = partial(self._send, service, request, answered)
        unsent = _Unsent(self._clock.now_ns() + _FOUND_NS, service, send, answered)
        if self._is_found(unsent):
            send()
            return
        with self._changing:
            self._unsent.append(unsent)

    def _is_found(self, call: _Unsent) -> bool:
        """Return whether a node offers the service, and receives that the page attends.

        Else a session would not miss a page that is lost at once: the bridge's end of a connection
        is there before the session's.
        """
        if not is_served(self._node, self._clients[call.service]):
            return False
        publisher = self._attendance.get(call.service)
        if publisher is None:
            return True
        if not call.attended:
            if not publisher.get_subscription_count():
                return False
            self._attend(call.service)
            call.attended = True
        return publisher.wait_for_all_acked(_AT_ONCE)

    def _attend(self, service: str) -> None:
        publisher = self._attendance[service]
        publisher.publish(publisher.msg_type())

    def _send(self, service: str, request: Any, answered: Callable[[Any, bool], None]) -> None:
        client = self._clients[service]
        if service in self._attendance:
            self._attend(service)  # once more: a session forgets an old word at its start
        future = client.call_async(request)

        def given_up() -> None:
            client.remove_pending_request(future)
            answered(f"{service} did not answer within {self._answer_ns * 1e-9:g} s", False)

        with self._changing:
            self._waiting[future] = (self._clock.now_ns() + self._answer_ns, given_up)

        def done(_: Any) -> None:
            if self._taken(future):
                error = future.exception()
                answered(f"{service}: {error}" if error else plain(future.result()), not error)

        future.add_done_callback(done)

    def _taken(self, future: Any) -> bool:
        """Remove a call from the list; return whether it was still on it."""
        with self._changing:
            return self._waiting.pop(future, None) is not None

    def _check_calls(self) -> None:
        """Send the requests whose service has appeared; give up calls beyond the time limit."""
        now_ns = self._clock.now_ns()
        with self._changing:
            unsent, self._unsent = self._unsent, []
        for call in unsent:
            late = now_ns >= call.due_ns
            # A subscriber that is frozen must not keep a session from being started or resumed.
            if self._is_found(call) or (late and call.attended):
                call.send()
            elif late:
                call.answered(f"nobody offers {call.service}: is its node running?", False)
            else:
                with self._changing:
                    self._unsent.append(call)
        with self._changing:
            late = [(f, give_up) for f, (due, give_up) in self._waiting.items() if now_ns >= due]
        for future, give_up in late:
            if self._taken(future):
                give_up()
