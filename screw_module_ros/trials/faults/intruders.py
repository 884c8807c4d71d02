# SPDX-License-Identifier: Apache-2.0
"""Intruders in the graph: second publishers, second nodes, foreign CAN masters.

Their threads take part in simulated time, so that they act at defined times.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from rclpy.context import Context
from rclpy.node import Node

from screw_module_ros.can_io.bus import BusSettings, open_port
from screw_module_ros.can_io.port import Port
from screw_module_ros.clock import Clock
from screw_module_ros.graph import bus_of
from screw_module_ros.lockstep.end import End
from screw_module_ros.nodes import bringup
from screw_module_ros.nodes.support import topics
from screw_module_ros.nodes.support.inbox import Inbox
from screw_module_ros.operator.robot import RobotError

from ..graph_run import GraphRun
from .creep import creep, creep_until

_MATCHED_S = 5.0  # wall clock
_SETTLED_S = 0.05  # the subscriber may see the match a moment later
_TICK_NS = 1_000_000
_OFF_TICK_NS = 300_000
"""Intruders publish between the ticks, when a node is idle."""


class Intruders:
    """Starts and holds intruding processes, publishers and ports; `dismiss` removes them."""

    def __init__(self, clock: Clock, graph: GraphRun):
        self._clock, self._graph = clock, graph
        self._context = Context()
        self._context.init()
        # Not spun: an executor fails if a publisher is removed while it spins.
        self._node = Node("intruder", context=self._context)
        self._inbox = Inbox(self._node, self._clock)
        self._over = threading.Event()
        self._threads: list[threading.Thread] = []
        self._publishers: list[_SecondPublisher] = []
        self._ports: list[Port] = []
        self._guests: list[bringup.Process] = []

    def start(self, node: str, *arguments: str) -> int:
        """Start one more process of an executable, with the same parameters; return its id."""
        own = f"{node}:"
        inherited = [word.removeprefix(own) for word in self._graph.arguments("sim_rig")]
        guest = bringup.Process(node, ["--ros-args", *inherited, *arguments])
        self._guests.append(guest)
        return guest.pid

    def publish(
        self, kind: type, topic: str, make: Callable[[], Any], count: int, period: float
    ) -> float:
        """Publish the messages of `make` on a topic each `period` [s], between the ticks.

        count: number of messages, 0 = until `dismiss`. Returns the simulated time of the start
        [s]. Raises RobotError without a subscriber.
        """
        second = _SecondPublisher(self._node, self._clock, kind, topic)
        self._publishers.append(second)
        self._await_listeners(second, topic)
        begin_ns = self._clock.now_ns()
        if count:
            for _ in range(count):
                self._clock.sleep_until(_between_ticks(self._clock.now_ns(), period))
                second.publish(make())
        else:
            self.repeat(lambda: second.publish(make()), period)
        return begin_ns * 1e-9

    def _await_listeners(self, second: _SecondPublisher, topic: str) -> None:
        """Wait for a subscriber: the first message must come before the count of publishers."""
        if not creep_until(self._clock, second.listeners, _MATCHED_S):
            raise RobotError(f"no subscriber on {topic}")
        creep(self._clock, _SETTLED_S)

    def listen(self, kind: type, topic: str) -> Callable[[], Any]:
        """Return a function that returns the topic's next message or None, until `dismiss`."""
        return self._inbox.subscribe(kind, topic, topics.STATE)

    def repeat(self, act: Callable[[], object], period: float) -> None:
        """Call `act` each `period` [s] of simulated time until `dismiss`."""
        thread = threading.Thread(target=self._repeat, args=(act, period), daemon=True)
        self._threads.append(thread)
        thread.start()

    def _repeat(self, act: Callable[[], object], period: float) -> None:
        try:
            while not self._over.is_set():
                self._clock.sleep_until(_between_ticks(self._clock.now_ns(), period))
                act()
        finally:
            self._clock.leave()

    def port(self, node: str) -> Port:
        """Return a foreign master's access to the CAN bus of a driver node, until `dismiss`."""
        bus = BusSettings(channel=bus_of(node), sync_producer=False)
        port = open_port(bus, self._clock)
        self._ports.append(port)
        return port

    def dismiss(self) -> None:
        """Remove all intruders."""
        self._over.set()
        if self._threads:
            self._clock.idle()  # each thread ends at its next act, in simulated time
        for thread in self._threads:
            thread.join(timeout=2.0)
        for second in self._publishers:
            second.close()
        self._inbox.close()
        for port in self._ports:
            port.close()
        for guest in self._guests:
            guest.stop()
        self._threads, self._publishers, self._ports, self._guests = [], [], [], []
        self._over.clear()

    def close(self) -> None:
        """Leave the graph."""
        self.dismiss()
        self._node.destroy_node()
        self._context.try_shutdown()


class _SecondPublisher:
    """A second publisher of a topic, whose messages also hold simulated time."""

    def __init__(self, node: Node, clock: Any, kind: type, topic: str):
        self._node = node
        self._publisher = node.create_publisher(kind, topic, topics.COMMAND)
        self._end = End(clock.page, self._publisher.topic_name, sends=True)

    def listeners(self) -> int:
        """Return the number of subscriptions."""
        return self._publisher.get_subscription_count()

    def publish(self, message: Any) -> None:
        """Publish one message."""
        self._end.count()
        self._publisher.publish(message)
        self._end.announce()

    def close(self) -> None:
        """Remove the publisher."""
        self._end.close()
        self._node.destroy_publisher(self._publisher)


def _between_ticks(now_ns: int, period: float) -> int:
    """Return the first time [ns] between two ticks that is about `period` [s] from now."""
    period_ns = round(period * 1e9)
    if period_ns >= _TICK_NS:
        return (now_ns + period_ns) // _TICK_NS * _TICK_NS + _OFF_TICK_NS
    half_ns = period_ns // 2
    return ((now_ns - half_ns) // period_ns + 1) * period_ns + half_ns
