# SPDX-License-Identifier: Apache-2.0
"""Topics between the nodes of one process: serialized messages pass by calls.

Everything is published by the middleware too, for other processes; only the way within the process
is another one. A message is serialized once, so no reader sees an object that its publisher fills
again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.serialization import deserialize_message

from screw_module_ros.graph import TOPICS
from screw_module_ros.lockstep.clock import SimulatedClock
from screw_module_ros.lockstep.end import End
from screw_module_ros.lockstep.page import NOW

from .wire import Layout

Queue = deque[tuple[int, int, bytes]]
"""Messages that wait: time at which each was published [ns], its number from 1, its bytes."""


class LocalTopics:
    """The topics whose only publisher is one of `nodes`, the names of those in this process."""

    def __init__(self, nodes: Collection[str]):
        self._nodes = frozenset(nodes)
        self._readers: dict[str, list[Queue]] = {}

    def carries(self, topic: str) -> bool:
        """Return whether a topic of the graph passes by calls: not one below its node's name."""
        return topic in TOPICS and TOPICS[topic].publisher in self._nodes and topic[0] != "~"

    def read(self, name: str, depth: int | None) -> Queue:
        """Return a new queue of a topic (full name), of so many messages; None: of all."""
        queue: Queue = deque(maxlen=depth)
        self.readers_of(name).append(queue)
        return queue

    def leave(self, name: str, queue: Queue) -> None:
        """Put nothing into a queue any more."""
        readers = self.readers_of(name)
        readers[:] = [each for each in readers if each is not queue]

    def readers_of(self, name: str) -> list[Queue]:
        """Return the queues of a topic (full name); the list stays the same object."""
        return self._readers.setdefault(name, [])

    def subscribe(
        self, name: str, kind: type | Layout, depth: int, wakes: bool, clock: SimulatedClock
    ) -> LocalSubscription:
        """Return a subscription; arguments: as of `Inbox.subscribe`, with the full name."""
        return LocalSubscription(self, clock, name, kind, depth, wakes)

    def publishing(
        self, name: str, kind: type, raw: bool, handle: Any, end: End
    ) -> Callable[[Any], None]:
        """Return what publishes to the readers in this process and, by `handle`, to all others.

        raw: it takes bytes. end: counts what is published.
        """
        readers, header, number = self.readers_of(name), end.page.header, 0
        serialize = _rclpy.rclpy_serialize
        send_bytes = end.counted(handle.publish_raw)
        send = send_bytes if raw else end.counted(handle.publish)

        def publish(message: Any) -> None:
            nonlocal number
            number += 1
            if not readers:
                send(message)
                return
            data = message if raw else serialize(message, kind)
            entry = header[NOW], number, data
            for queue in readers:
                queue.append(entry)
            send_bytes(data)

        return publish


class LocalSubscription:
    """A subscription within the process, of the same use as `inbox.Subscription`.

    A message published on a tick arrives on the next one, unless this subscription wakes its loop.
    arrived_ns: time at which the message returned last came [ns].
    """

    has_kept = False
    """No message is kept back: one that is early stays in the queue."""

    def __init__(
        self, topics: LocalTopics, clock: SimulatedClock, name: str, kind: type | Layout,
        depth: int, wakes: bool,
    ):  # fmt: skip
        self._header, self._depth, self._wakes = clock.page.header, depth, wakes
        self._unpack = kind.unpack if isinstance(kind, Layout) else (
            lambda data: deserialize_message(data, kind)
        )  # fmt: skip
        # One more place: a message of this tick must not push out that of the last one.
        self.end = topics.read(name, depth + 1)
        self.close = lambda: topics.leave(name, self.end)
        self.arrived_ns = 0

    def __call__(self, early: bool | None = None) -> Any:
        """Return the next message, None without one; early: as of `inbox.Subscription`."""
        queue = self.end
        if not queue:
            return None
        if early is None:
            early = self._wakes
        now_ns, found = self._header[NOW], None
        while queue and (early or queue[0][0] < now_ns):
            self.arrived_ns, _, found = queue.popleft()
            if self._depth != 1:
                break
        return None if found is None else self._unpack(found)

    def discard(self) -> None:
        """Drop what has come so far."""
        self.end.clear()
