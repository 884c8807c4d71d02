# SPDX-License-Identifier: Apache-2.0
"""Intruders in the graph: second publishers, second nodes, foreign CAN masters.

Their threads take part in simulated time, so that they act at defined times, between the ticks.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from rclpy.context import Context
from rclpy.node import Node

from screw_module_ros.can_io.bus import BusSettings, open_port
from screw_module_ros.can_io.port import Port
from screw_module_ros.clock import TimeStandsStill
from screw_module_ros.graph import bus_of
from screw_module_ros.lockstep.end import End
from screw_module_ros.nodes import bringup
from screw_module_ros.nodes.support import topics
from screw_module_ros.nodes.support.inbox import Inbox
from screw_module_ros.operator.robot import RobotError

_MATCHED_S = 5.0  # wall clock
_SETTLED_S = 0.2  # the subscribers may see the match a moment later
_ENDED_S = 30.0  # wall clock in which 0.1 s of simulated time passes anywhere
_STILL_NS = 400_000_000
"""Wall clock for which time may stand still; the lock step drops whoever holds it for 1 s."""
_TICK_NS = 1_000_000
_OFF_TICK_NS = 300_000
"""Intruders publish between the ticks, when a node is idle."""


class Intruders:
    """Starts and holds intruding processes, publishers and ports; `dismiss` removes them.

    robot: whose graph, clock and waits they use.
    """

    def __init__(self, robot):
        self._robot, self._clock = robot, robot.clock
        self._context = Context()
        self._context.init()
        # Not spun: an executor fails if a publisher is removed while it spins.
        self._node = Node("intruder", context=self._context)
        self._inbox = Inbox(self._node, self._clock)
        self._over = threading.Event()
        self._threads: list[threading.Thread] = []
        self._publishers: list[tuple[Any, End]] = []
        self._ports: list[Port] = []
        self._guests: list[bringup.Process] = []

    def start(self, node: str, *arguments: str) -> int:
        """Start one more process of an executable, with the same parameters; return its id."""
        own = f"{node}:"
        inherited = [word.removeprefix(own) for word in self._robot.graph.arguments("sim_rig")]
        guest = bringup.Process(node, ["--ros-args", *inherited, *arguments])
        self._guests.append(guest)
        return guest.pid

    def publish(
        self, kind: type, topic: str, make: Callable[[], Any], count: int, period: float
    ) -> float:
        """Publish the messages of `make` on a topic each `period` [s], between the ticks.

        count: number of messages, 0 = until `dismiss`. Returns the simulated time of the first
        [s]. Raises RobotError without a subscriber.
        """
        # The first message must come before the count of publishers, which each 0.1 s of simulated
        # time may bring: time stands still between two ticks while the middleware finds them.
        self._clock.sleep_until(_between_ticks(self._clock.now_ns(), _TICK_NS * 1e-9))
        publisher = self._node.create_publisher(kind, topic, topics.COMMAND)
        end = End(self._clock.page, publisher.topic_name, sends=True)  # messages hold time, too
        self._publishers.append((publisher, end))
        matched = publisher.get_subscription_count
        if not self._robot.creep_until(matched, _MATCHED_S, _STILL_NS):
            raise RobotError(f"no subscriber on {topic}")
        self._robot.creep_until(lambda: False, _SETTLED_S, _STILL_NS)

        def send() -> None:
            message = make()
            end.count()
            publisher.publish(message)
            end.announce()

        begin_ns = self._clock.now_ns()
        send()
        if not count:
            self.repeat(send, period)
        for _ in range(count - 1):
            self._clock.sleep_until(_between_ticks(self._clock.now_ns(), period))
            send()
        return begin_ns * 1e-9

    def listen(self, kind: type, topic: str) -> Callable[[], Any]:
        """Return a function that returns the topic's next message or None, until `dismiss`."""
        return self._inbox.subscribe(kind, topic, topics.STATE)

    def repeat(self, act: Callable[[], object], period: float) -> None:
        """Call `act` each `period` [s] of simulated time until `dismiss`."""

        over = self._over

        def run() -> None:
            try:
                while not over.is_set():
                    try:
                        self._clock.sleep_until(_between_ticks(self._clock.now_ns(), period))
                    except TimeStandsStill:  # a process starts, or the row has ended the rig
                        over.wait(_SETTLED_S)
                        continue
                    if not over.is_set():
                        act()
            finally:
                self._clock.leave()

        thread = threading.Thread(target=run, daemon=True)
        self._threads.append(thread)
        thread.start()

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
            thread.join(timeout=_ENDED_S)
        for publisher, end in self._publishers:
            end.close()
            self._node.destroy_publisher(publisher)
        self._inbox.close()
        for port in self._ports:
            port.close()
        for guest in self._guests:
            guest.stop()
        self._threads, self._publishers, self._ports, self._guests = [], [], [], []
        self._over = threading.Event()

    def close(self) -> None:
        """Leave the graph."""
        self.dismiss()
        self._node.destroy_node()
        self._context.try_shutdown()


def _between_ticks(now_ns: int, period: float) -> int:
    """Return the first time [ns] between two ticks that is about `period` [s] from now."""
    period_ns = round(period * 1e9)
    if period_ns >= _TICK_NS:
        return (now_ns + period_ns) // _TICK_NS * _TICK_NS + _OFF_TICK_NS
    half_ns = period_ns // 2
    return ((now_ns - half_ns) // period_ns + 1) * period_ns + half_ns
