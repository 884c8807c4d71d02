# SPDX-License-Identifier: Apache-2.0
"""One running graph, on which rows are carried out one after the other.

`ready` brings the robot from any state to operation without a restart of the graph.
"""

from __future__ import annotations

import math
import signal
from collections.abc import Callable, Iterable
from typing import Any

from screw_module_ros import graph
from screw_module_ros.clock import WallClock
from screw_module_ros.graph import nodes_of
from screw_module_ros.operator.robot import Robot, RobotError

from ..graph_run import GraphRun
from .creep import creep_until
from .intruders import Intruders
from .limits import TRUTH_RATE
from .listener import Listener
from .patient import Patient
from .recovery import Recovery

STIFFNESS, PLANE_STIFFNESS, PLANE_DAMPING = 100.0, 100.0, 10.0
FORCE_GAIN = 2.0
_ENDED_S, _STARTED_S = 12.0, 60.0  # wall clock
_ONE_SENDER = {
    graph.SAFETY_STATE: "supervisor",
    graph.FORCE_COMMAND: "impedance_controller",
    graph.ENCODER: "encoder",
    graph.FORCE: "force_sensor",
}
"""Topics with a single publisher: with two, their subscribers enable no drive. The middleware
drops a killed publisher after 20 s of wall clock."""
_POLL_NS = 5_000_000
_WALL = WallClock()  # for the start and end of processes
_FAST = ("-p", "sim_rig:speed:=0.0", "-p", f"sim_rig:truth_rate:={TRUTH_RATE}")


class Testbed:
    """The graph in simulated time, an operator, a patient, a game, and faults.

    deadline: simulated time by which the row must end [s]. added: what the row has added to the
    graph, by name.
    """

    def __init__(self, extra: Iterable[str] = (), composed: bool = False):
        """Prepare; `extra` goes to every node's --ros-args, `composed` as of `bringup.start`."""
        self.composed = composed
        self.graph = GraphRun(extra=[*_FAST, *extra], composed=composed)
        self.robot: Robot = None
        self.listener: Listener = None
        self.patient: Patient = None
        self.recovery: Recovery = None
        self.intruders: Intruders = None
        self.deadline = math.inf
        self.added: dict[str, Any] = {}
        self._frozen: set[str] = set()
        self._restarted: set[str] = set()

    def __enter__(self) -> Testbed:
        self.graph.__enter__()
        try:
            self.robot = Robot("fault_operator", watch=self._watch, simulated=True)
            self.listener = Listener(self.robot)
            self.patient = Patient(self.robot, self.listener)
            self.recovery = Recovery(self.robot, self.listener, self.patient)
            self.intruders = Intruders(self.robot.clock, self.graph)
            self.graph.wait_until_ready(self.robot)
            self._prepare()
        except BaseException:
            self.__exit__(None, None, None)
            raise
        return self

    def __exit__(self, *_: object) -> None:
        for node in tuple(self._frozen):
            self.thaw(node)
        if self.intruders is not None:
            self.intruders.close()
        for client in (self.listener, self.robot):
            if client is not None:
                client.close()
        self.graph.__exit__(None, None, None)

    def _watch(self) -> None:
        self.graph.watch()
        if self.listener is None:
            return
        self.listener.look()
        if self.listener.time > self.deadline:
            raise RobotError(f"the row takes too long{self.robot.complaints_text()}")

    def _prepare(self) -> None:
        self.robot.wait_until(lambda: self.listener.now is not None, 5.0, "no sim/truth")
        self.robot.set_fixture("free")
        self.robot.tare()
        self.robot.set_fixture("human_arm")
        self.patient.set_up()
        self.configure()

    def configure(self) -> None:
        """Set the controllers' parameters, after their start."""
        robot = self.robot
        robot.set_impedance(STIFFNESS, 0.0)
        robot.set_impedance(PLANE_STIFFNESS, PLANE_DAMPING, node="manus")
        robot.set_parameter("impedance_controller", "force_gain", FORCE_GAIN)

    # Processes -----------------------------------------------------------------------------

    def kill(self, node: str) -> None:
        """End a node with SIGKILL; simulated time stands still until it has ended."""
        self.graph.signal(node, signal.SIGKILL)
        self._await_by_wall(lambda: self.graph.exit_code(node) is not None, f"{node} did not end")

    def terminate(self, node: str) -> None:
        """End a node with SIGTERM."""
        self.graph.signal(node, signal.SIGTERM)

    def freeze(self, node: str) -> None:
        """Stop a node's process with SIGSTOP."""
        self._frozen.add(node)
        self.graph.signal(node, signal.SIGSTOP, ends=False)

    def thaw(self, node: str) -> None:
        """Continue a frozen process."""
        self._frozen.discard(node)
        if self.graph.exit_code(node) is None:
            self.graph.signal(node, signal.SIGCONT, ends=False)

    def await_end(self, nodes: Iterable[str]) -> None:
        """Wait until these processes have ended."""
        self.robot.clock.idle()
        for node in nodes:
            self._await_by_wall(
                lambda node=node: self.graph.exit_code(node) is not None, f"{node} did not end"
            )

    def _await_by_wall(self, condition: Callable[[], object], what: str) -> None:
        end_ns = _WALL.now_ns() + round(_ENDED_S * 1e9)
        while not condition():
            if _WALL.now_ns() > end_ns:
                raise RobotError(what)
            _WALL.sleep_until(_WALL.now_ns() + _POLL_NS)

    def restart(self, node: str) -> None:
        """Start a node again, after waiting for its end."""
        self.await_end([node])
        self.graph.restart(node)
        self._restarted.add(node)

    def start_guest(self, node: str, *arguments: str) -> None:
        """Start one more process of an executable; return when it takes part in simulated time."""
        self._await_start(self.intruders.start(node, *arguments), f"the second {node}")

    # Recovery ------------------------------------------------------------------------------

    def ready(self, mode: int) -> None:
        """Bring the robot to operation in `mode`, the hand at rest. Raises RobotError if not."""
        self.await_restarted()
        self.patient.rest()
        self.recovery.go(mode)

    def await_restarted(self) -> None:
        """Wait until the restarted nodes are active, and set their parameters."""
        if not self._restarted:
            return
        processes, self._restarted = self._restarted, set()
        for process in processes:
            self._await_start(self.graph.pid(process), process)
        nodes = {node for process in processes for node in nodes_of(process)}
        self.robot.wait_until_ready(nodes)
        for topic, owner in _ONE_SENDER.items():
            if owner in nodes:
                self._creep_until(
                    lambda topic=topic: self.robot.node.count_publishers(topic) <= 1,
                    f"the middleware does not drop the ended publisher of {topic}",
                )
        if nodes & {"impedance_controller", "manus"}:
            self.configure()
        if "sim_rig" in nodes:
            self.robot.wait_until(lambda: self.listener.fresh("sim_rig"), 5.0, "no sim/truth")
            self.patient.set_up()

    def _await_start(self, pid: int, name: str) -> None:
        page = self.robot.clock.page
        self._creep_until(lambda: pid in page.thread_pid, f"{name} does not start")

    def _creep_until(self, condition: Callable[[], object], what: str) -> None:
        """Wait for processes and the middleware. Raises RobotError(`what`) after 60 s."""

        def watched() -> object:
            self.graph.watch()
            return condition()

        if not creep_until(self.robot.clock, watched, _STARTED_S):
            raise RobotError(what)
