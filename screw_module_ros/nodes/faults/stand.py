# SPDX-License-Identifier: Apache-2.0
"""One running graph on which the rows are carried out, one after the other.

`ready` brings the robot from whatever state to operation; the graph is not started anew.
"""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Callable, Iterable
from typing import Any

import can
from rclpy.context import Context
from rclpy.node import Node

from screw_module_ros.devices.bus import BusSettings, open_bus

from .. import bringup
from ..support import qos
from ..support.graph_run import GraphRun
from ..support.isolation import BUSES, NODE_OF_BUS
from ..support.realtime import Inbox
from ..support.robot import Robot, RobotError
from .listener import Listener
from .patient import Patient
from .ticks import PERIOD, slow_ticks
from .way_back import WayBack

STIFFNESS, PLANE_STIFFNESS, PLANE_DAMPING = 100.0, 100.0, 10.0
FORCE_GAIN = 2.0
_ENDED_S = 12.0
_MATCHED_S = 0.05  # the other end may know of a match a moment later
_BUS_OF = {node: bus for bus, node in NODE_OF_BUS.items()}


class Stand:
    """The graph, an operator, a patient, a game, and means to do harm."""

    def __init__(self, extra: list[str] | None = None, paused: Callable[[], float] = lambda: 0.0):
        """Prepare; `extra` goes to every node's --ros-args.

        paused: for how long the machine has stood still up to now [ms].
        """
        self._paused = paused
        self.graph = GraphRun(extra=[*slow_ticks(), *(extra or [])])
        self.robot: Robot = None
        self.heard: Listener = None
        self.patient: Patient = None
        self.way_back: WayBack = None
        self._context = Context()
        self._intruder: Node | None = None
        self._inbox: Inbox | None = None
        self.deadline = math.inf
        self._frozen: set[str] = set()
        self._restarted: set[str] = set()
        self._over = threading.Event()
        self._threads: list[threading.Thread] = []
        self._publishers: list[Any] = []
        self._buses: list[can.BusABC] = []
        self._guests: list[bringup.Process] = []

    def __enter__(self) -> Stand:
        self.graph.__enter__()
        try:
            self.robot = Robot("fault_operator", watch=self._watch)
            self.heard = Listener()
            self.patient = Patient(self.robot, self.heard)
            self.way_back = WayBack(self.robot, self.heard, self.patient)
            self._context.init()
            # Nobody spins it: an executor trips over a publisher that is removed under it.
            self._intruder = Node("intruder", context=self._context)
            self._inbox = Inbox(self._intruder)
            self.graph.wait_until_ready(self.robot, told=lambda waiting: None)
            self._prepare()
        except BaseException:
            self.__exit__(None, None, None)
            raise
        return self

    def __exit__(self, *_: object) -> None:
        for node in tuple(self._frozen):
            self.thaw(node)
        if self.heard is not None:
            self.dismiss()
        for client in (self.robot, self.heard):
            if client is not None:
                client.close()
        if self._intruder is not None:
            self._intruder.destroy_node()
        self._context.try_shutdown()
        self.graph.__exit__(None, None, None)

    def _watch(self) -> None:
        self.graph.watch()
        if time.monotonic() > self.deadline:
            raise RobotError(f"the row's time is over{self.robot.complaints_text()}")

    def _prepare(self) -> None:
        self.robot.wait_until(lambda: self.heard.now is not None, 5.0, "no sim/truth")
        self.robot.set_fixture("free")
        self.robot.tare()
        self.robot.set_fixture("human_arm")
        self.patient.set_up()
        self.configure()

    def configure(self) -> None:
        """Set what the controllers start with, after a start of theirs."""
        robot = self.robot
        robot.set_impedance(STIFFNESS, 0.0)
        robot.set_impedance(PLANE_STIFFNESS, PLANE_DAMPING, node="manus")
        robot.set_parameter("impedance_controller", "force_gain", FORCE_GAIN)

    # Processes -----------------------------------------------------------------------------

    def kill(self, node: str) -> None:
        """End a node with SIGKILL."""
        self.graph.signal(node, signal.SIGKILL)

    def terminate(self, node: str) -> None:
        """End a node with SIGTERM."""
        self.graph.signal(node, signal.SIGTERM)

    def freeze(self, node: str) -> None:
        """Stop a node's process with SIGSTOP."""
        self._frozen.add(node)
        self.graph.signal(node, signal.SIGSTOP, ends=False)

    def thaw(self, node: str) -> None:
        """Let a frozen process go on."""
        self._frozen.discard(node)
        if self.graph.exit_code(node) is None:
            self.graph.signal(node, signal.SIGCONT, ends=False)

    def await_end(self, nodes: Iterable[str]) -> None:
        """Wait until these processes have ended."""
        for node in nodes:
            self.robot.wait_until(
                lambda node=node: self.graph.exit_code(node) is not None,
                _ENDED_S,
                f"{node} did not end",
            )

    def restart(self, node: str) -> None:
        """Start a node again that has ended, or is about to."""
        self.await_end([node])
        self.graph.restart(node)
        self._restarted.add(node)

    # Intruders -----------------------------------------------------------------------------

    def start(self, node: str, *arguments: str) -> None:
        """Start one more process of an executable, with the same CAN ports."""
        own = f"{node}:"
        given = [word.removeprefix(own) for word in self.graph.arguments(node)]
        words = ["--ros-args", *given, *arguments]
        self._guests.append(bringup.Process(node, words))

    def stood_still(self) -> float:
        """Return for how long the machine stood still, by its cores and by the rig's clock [ms]."""
        return self._paused() + self.heard.slipped

    def just_now(self) -> float:
        """Return the simulated time of something that has just been done, at most a tick early."""
        return self.heard.now.time - PERIOD

    def intrude(
        self, kind: type, topic: str, make: Callable[[], Any], count: int = 0, period: float = 0.002
    ) -> float:
        """Publish what `make` returns on a topic, `count` times or until `dismiss` (count 0).

        Returns the simulated time when it began [s].
        """
        publisher = self._intruder.create_publisher(kind, topic, qos.COMMAND)
        self._publishers.append(publisher)
        self.robot.wait_until(
            lambda: publisher.get_subscription_count() > 0, 5.0, f"nobody listens on {topic}"
        )
        self.robot.pause(_MATCHED_S)
        begin = self.heard.now.time
        if count:
            for _ in range(count):
                publisher.publish(make())
                self._over.wait(period)
        else:
            self.babble(lambda: publisher.publish(make()), period)
        return begin

    def listen(self, kind: type, topic: str) -> Callable[[], Any]:
        """Return what takes the next message of a topic, or None; it works until `dismiss`."""
        return self._inbox.subscribe(kind, topic, qos.STATE)

    def babble(self, act: Callable[[], object], period: float) -> None:
        """Do something again and again until `dismiss`."""
        thread = threading.Thread(target=self._babble, args=(act, period), daemon=True)
        self._threads.append(thread)
        thread.start()

    def _babble(self, act: Callable[[], object], period: float) -> None:
        while not self._over.wait(period):
            act()

    def bus(self, node: str) -> can.BusABC:
        """Open a foreign master's access to the CAN bus of a driver node, until `dismiss`."""
        port = self.graph.place.first_port + BUSES.index(_BUS_OF[node])
        bus = open_bus(BusSettings(port=port))
        self._buses.append(bus)
        return bus

    def dismiss(self) -> None:
        """Send every intruder away."""
        self._over.set()
        for thread in self._threads:
            thread.join(timeout=2.0)
        for publisher in self._publishers:
            self._intruder.destroy_publisher(publisher)
        if self._inbox is not None:
            self._inbox.close()
        for bus in self._buses:
            bus.shutdown()
        for guest in self._guests:
            guest.stop()
        self._threads, self._publishers, self._buses, self._guests = [], [], [], []
        self._over.clear()

    # The way back --------------------------------------------------------------------------

    def ready(self, mode: int) -> None:
        """Bring the robot to operation in `mode`, the hand at rest. Raises RobotError if stuck."""
        self.await_restarted()
        self.patient.rest()
        self.way_back.go(mode)

    def await_restarted(self) -> None:
        """Wait until the nodes that were started again are active, and set them up."""
        if not self._restarted:
            return
        nodes, self._restarted = self._restarted, set()
        self.robot.wait_until_ready(nodes)
        if nodes & {"impedance_controller", "manus"}:
            self.configure()
        if "sim_rig" in nodes:
            self.robot.wait_until(lambda: self.heard.fresh("sim_rig"), 5.0, "no sim/truth")
            self.patient.set_up()

    def until(self, condition: Callable[[], Any], deadline_s: float) -> bool:
        """Wait for a condition; return whether it came true in time."""
        return self.robot.met(condition, deadline_s)
