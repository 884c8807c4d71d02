# SPDX-License-Identifier: Apache-2.0
"""Topics and services of the robots, for the clients of the bridge.

The gateway takes no part in simulated time, because a browser must not delay the robot. It polls
its subscriptions, which hold only the newest message: a topic at 200 Hz costs only as much as the
bridge sends of it. A message is converted to JSON once, for its first client. All of it runs in the
server's thread; of rclpy's only the end of a call comes from another one.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from typing import Any

from rcl_interfaces.msg import Log
from rclpy.qos import QoSProfile
from screw_module_msgs.srv import StartTherapy

from screw_module_ros.bridge.client import ServiceError
from screw_module_ros.bridge.messages import as_json, filled, plain
from screw_module_ros.bridge.rights import (
    ACTION,
    CALL,
    KEPT,
    PATIENT,
    PUBLISH,
    ROLES,
    SUBSCRIBE,
    Place,
    Rights,
)
from screw_module_ros.clock import WallClock
from screw_module_ros.graph import THERAPY_STATE, interface_class
from screw_module_ros.therapy.session import UNDER_WAY, State

from .support import topics
from .support.inbox import HotGroup, never
from .support.node import Node
from .support.topics import is_served

_OLD_NS = 1_000_000_000  # a state this old says nothing about the robot of now
_MOST_KEPT = 1100  # a session of the clock game has 1024 movements
_MOST_ACTIONS = 100  # the newest ones of a page, which wait for the recording of a session
_CHECK_S = 0.1
_FOUND_S = 5.0  # the middleware repeats lost announcements each 3 s


class PolledTopic:
    """A polled subscription with its newest message. newest: None before the first."""

    def __init__(self, node: Node, name: str, kind: str, profile: QoSProfile, group: HotGroup):
        self.kind = interface_class(kind)
        self.subscription = node.create_subscription(
            self.kind, name, never, profile, callback_group=group
        )
        self.newest: Any = None
        self._number = self._arrived_ns = 0
        self._text = ""

    def poll(self) -> None:
        """Take the messages that have arrived."""
        while (taken := self.subscription.handle.take_message(self.kind, False)) is not None:
            self.newest, info = taken
            self._number, self._text = self._number + 1, ""
            self._arrived_ns = info["received_timestamp"]  # it may have waited for a client
            self.took()

    def took(self) -> None:
        """Act on a message that was just taken."""

    def forget(self) -> None:
        """Show new subscribers nothing of what has come, if it does not age by itself."""

    def begin(self) -> int:
        """Return the number of the last message that a new subscriber does not get."""
        return 0

    def after(self, number: int, stamp_ns: int) -> list[tuple[int, str]]:
        """Return the newest message as JSON, with its number from 1; nothing unless it is new.

        stamp_ns: time of the system clock [ns]. A page that connects would take the last message
        of a dead node for news.
        """
        if self._number == number or stamp_ns - self._arrived_ns > _OLD_NS:
            return []
        self._text = self._text or as_json(self.newest)
        return [(self._number, self._text)]


class KeptTopic(PolledTopic):
    """A topic of which each message of the running session counts; they do not age.

    rising: fields that rise within a session.
    """

    def __init__(self, *given: Any, rising: tuple[str, ...]):
        super().__init__(*given)
        self._rising, self._last = rising, ()
        self._kept: deque[tuple[int, str]] = deque(maxlen=_MOST_KEPT)
        self._before = 0  # number of the last message of earlier sessions

    def took(self) -> None:
        """Keep the message, as JSON now: a thousand at once would hold up every client."""
        last, self._last = self._last, tuple(getattr(self.newest, name) for name in self._rising)
        if self._last <= last:  # another session has begun
            self._before = self._number - 1
            self._kept.clear()  # of the patient before: whoever was there has got it
        self._kept.append((self._number, as_json(self.newest)))

    def forget(self) -> None:
        """Show new subscribers nothing of what has come."""
        self._before = self._number

    def begin(self) -> int:
        """Return the number of the last message that a new subscriber does not get."""
        return self._before

    def after(self, number: int, stamp_ns: int) -> list[tuple[int, str]]:
        """Return each message after `number` as JSON, with its number, oldest first."""
        if self._number == number:
            return []
        return [each for each in self._kept if each[0] > number]


class BridgeGateway:
    """Topics and services of the robots that `rights` names; see `bridge.client.Gateway`.

    answer_s: time limit of a service call [s].
    """

    def __init__(self, node: Node, rights: Rights, answer_s: float):
        self._node, self._answer_s, self._clock = node, answer_s, WallClock()
        self._robots = rights.robots
        group = HotGroup()
        self._polled: dict[str, PolledTopic] = {}
        for place in rights.places(SUBSCRIBE):
            given = node, place.full, place.type
            self._polled[place.full] = (
                KeptTopic(*given, topics.STATE, group, rising=KEPT[place.name])
                if place.name in KEPT else PolledTopic(*given, topics.SAMPLE, group)
            )  # fmt: skip
        self._publishers = {
            place.full: node.create_publisher(
                interface_class(place.type), place.full, topics.COMMAND
            )
            for place in rights.places(PUBLISH)
        }
        self._actions = {(robot, page): deque[Log](maxlen=_MOST_ACTIONS)
                         for robot in rights.robots for page in ROLES}  # fmt: skip
        self._clients = {
            place.full: node.create_client(interface_class(place.type), place.full)
            for place in rights.places(CALL)
        }

    def close(self) -> None:
        """Destroy topics and clients."""
        for topic in self._polled.values():
            self._node.destroy_subscription(topic.subscription)
        for publisher in self._publishers.values():
            self._node.destroy_publisher(publisher)
        for client in self._clients.values():
            self._node.destroy_client(client)

    def poll(self) -> None:
        """Take new messages; forget the results of a session that has ended."""
        for polled in self._polled.values():
            polled.poll()
        for robot in self._robots:
            state = self._polled[Place(robot, THERAPY_STATE).full].newest
            if state is not None and state.state not in UNDER_WAY:
                for name in KEPT:
                    self._polled[Place(robot, name).full].forget()
            for page in ROLES if state is not None else ():
                self._tell_action(robot, self._actions[robot, page], state)

    def _tell_action(self, robot: str, waiting: deque[Log], state: Any) -> None:
        """Publish the oldest action while a session is recorded; forget those of one that is not.

        What was done since the session before, such as a start that was refused, comes with it.
        """
        if waiting and state.recorded:
            self._publishers[Place(robot, ACTION).full].publish(waiting.popleft())
        elif state.state in (State.RUNNING, State.PAUSED):
            waiting.clear()

    def act(self, robot: str, page: str, action: str, refused: bool = False) -> None:
        """Keep what a person did at the page of a role, for the bag of the robot's session.

        Of a patient nothing is kept after his session: the next bag is of another one.
        """
        state = self._polled[Place(robot, THERAPY_STATE).full].newest
        if page == PATIENT and (state is None or state.state not in UNDER_WAY):
            return
        log = Log(level=Log.WARN if refused else Log.INFO, name=page, msg=action)
        self._node.stamp(log)
        self._actions[robot, page].append(log)

    def begin(self, topic: str) -> int:
        """Return the number of the last message that a new subscriber does not get."""
        return self._polled[topic].begin()

    def after(self, topic: str, number: int) -> list[tuple[int, str]]:
        """Return what came after a message, with its numbers, as JSON: the newest, or each one."""
        return self._polled[topic].after(number, self._clock.stamp_ns())

    def publish(self, topic: str, content: dict) -> None:
        """Publish a message. Raises ValueError."""
        publisher: Any = self._publishers[topic]
        publisher.publish(filled(publisher.msg_type, content))

    async def call(self, service: str, arguments: dict) -> dict:
        """Call a service; return its response. Raises ValueError, ServiceError."""
        client: Any = self._clients[service]
        request = filled(client.srv_type.Request, arguments)
        if isinstance(request, StartTherapy.Request):
            request.attended = True  # by the page that asks, whatever it says
        await self._until_found(service)
        loop = asyncio.get_running_loop()
        answered = asyncio.Event()

        def done(_: Any) -> None:  # in the node's service thread
            with contextlib.suppress(RuntimeError):  # the loop has been closed since
                loop.call_soon_threadsafe(answered.set)

        future = client.call_async(request)
        future.add_done_callback(done)
        try:
            await asyncio.wait_for(answered.wait(), self._answer_s)
        except asyncio.TimeoutError:
            raise ServiceError(f"{service} did not answer within {self._answer_s:g} s") from None
        finally:
            client.remove_pending_request(future)
        if error := future.exception():
            raise ServiceError(f"{service}: {error}")
        return plain(future.result())

    async def _until_found(self, service: str) -> None:
        """Wait until a node offers the service. Raises ServiceError."""
        loop = asyncio.get_running_loop()
        late_s = loop.time() + _FOUND_S
        while not is_served(self._node, self._clients[service]):
            if loop.time() >= late_s:
                raise ServiceError(f"nobody offers {service}: is its node running?")
            await asyncio.sleep(_CHECK_S)
