# SPDX-License-Identifier: Apache-2.0
"""The robot on which rows are carried out one after the other, and what is done to its processes.

Processes and the middleware take wall clock, the robot's guards react in simulated time. So waits
for a process let simulated time only creep.
"""

from __future__ import annotations

import math
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hand import MARK, Hand
from intruders import Intruders
from record import Record
from row import LAW_OF_OTHERS, RATE, Row

from screw_module_ros import graph
from screw_module_ros.clock import WallClock
from screw_module_ros.lockstep.page import alive
from screw_module_ros.operator.bring_up import Operation, bring_up
from screw_module_ros.operator.robot import Robot, RobotError
from screw_module_ros.trials.runner import GraphRun, recordings_in

SPRING = (0.05, 0.05, MARK + 0.06, 0.0, 0.0, 0.0)
"""Set point off the hand, so that torque acts [m], [m/s]."""
_STIFFNESS, _PLANE_STIFFNESS, _PLANE_DAMPING = 100.0, 100.0, 10.0
_DAMPING = 6.0  # mode OBSERVER insists on 5.5 Ns/m
_FORCE_GAIN = 2.0
_ROW_S = 60.0
_GAME_NS = 50_000_000
_ENDED_S, _STARTED_S = 12.0, 60.0  # wall clock
_POLL_NS = 5_000_000
_CREEP_NS, _CREEP_S = 100_000_000, 0.0005
"""Each 0.1 s of wall clock the client lets 0.5 ms of simulated time pass, so that the lock step
does not drop it."""
_ONE_SENDER = {
    graph.SAFETY_STATE: "supervisor",
    graph.FORCE_COMMAND: "impedance_controller",
    graph.ENCODER: "encoder",
    graph.FORCE: "force_sensor",
}
"""Topics with a single publisher: with two, their subscribers enable no drive. The middleware
drops a killed publisher after 20 s of wall clock."""
_RAMP_S = 0.25  # half of the default: a step at the way back would be twice as large
_SETTINGS = {
    "sim_rig": ("speed:=0.0", f"truth_rate:={RATE / 2}"),
    "amplifier": (f"gate.ramp_time:={_RAMP_S}",),
    "manus": (f"gate.ramp_time:={_RAMP_S}",),
    "impedance_controller": (f'laws:=["{LAW_OF_OTHERS}"]', "support.coasting:=20.0"),
}
_WALL = WallClock()


class FaultRobot(Robot):
    """The graph in simulated time, an operator, a hand, a game, and intruders.

    shared: the process that its nodes share, as of `graph.chosen`. setpoint: (x, y, z, vx, vy, vz)
    of the game [m], [m/s]; None = no game. added: what the row has added to the graph, by name.
    """

    def __init__(self, shared: graph.Entry | None, folder: Path):
        """Start the graph, and wait until it is active. folder: of logs and recordings."""
        self.shared = shared
        self.setpoint: tuple[float, ...] | None = None
        self.added: dict[str, Any] = {}
        self.record: Record | None = None
        self._deadline = math.inf
        self._mended = True
        self._game_due_ns = 0
        self._frozen: set[str] = set()
        self._restarted: set[str] = set()
        given = [f"{node}:{one}" for node, several in _SETTINGS.items() for one in several]
        extra = [word for one in given for word in ("-p", one)]
        extra += ["--disable-stdout-logs", *recordings_in(folder)]
        self.graph = GraphRun(extra=extra, shared=shared)
        self.graph.__enter__()
        try:
            super().__init__("fault_operator", watch=self._look, simulated=True)
            self.record = Record(self)
            self.hand = Hand(self, self.record)
            self.intruders = Intruders(self)
            self.graph.wait_until_ready(self)
            self.wait_until(lambda: self.record.now is not None, 5.0, "no sim/truth")
            self.hand.set_up()
            self.configure()
        except BaseException:
            self.end()
            raise

    def end(self) -> None:
        """Stop everything."""
        for node in tuple(self._frozen):
            self.thaw(node)
        if hasattr(self, "intruders"):
            self.intruders.close()
        if self.record is not None:
            self.record.close()
            self.close()
        self.graph.__exit__()

    @property
    def time(self) -> float:
        """Present simulated time [s]."""
        return self.clock.now_ns() * 1e-9

    def until(self, time: float) -> None:
        """Let simulated time pass until `time` [s]; take what has come by then."""
        self.pause(max(0.0, time - self.time))
        self.record.look()

    def _look(self) -> None:
        """Take what has come, and publish the game's set point; called in every wait."""
        self.graph.watch()
        if self.record is None:
            return
        self.record.look()
        now_ns = self.clock.now_ns()
        if self.setpoint is not None and now_ns >= self._game_due_ns:
            self._game_due_ns = now_ns + _GAME_NS
            self.set_setpoint(*self.setpoint[:3], self.setpoint[3:])
        if self.time > self._deadline:
            raise RobotError(f"the row takes too long{self.complaints_text()}")

    def configure(self) -> None:
        """Set the controllers' parameters, after their start."""
        self.set_impedance(_STIFFNESS, _DAMPING)
        self.set_impedance(_PLANE_STIFFNESS, _PLANE_DAMPING, node="manus")
        self.set_parameter("impedance_controller", "force_gain", _FORCE_GAIN)

    # A row ---------------------------------------------------------------------------------

    def begin(self, row: Row) -> None:
        """Bring the robot to operation for a row, and move the hand until torque acts."""
        self._deadline, self._mended = self.time + _ROW_S, False
        row.prepare(self)
        self.ready(row.mode)
        self.hand.move(row.mode)

    def ready(self, mode: int) -> Operation:
        """Bring the robot to operation in `mode`, the hand at rest. Raises RobotError if not."""
        self.await_restarted()
        self.setpoint = SPRING
        self.hand.rest()
        return bring_up(self, mode, self.hand, ramp_s=_RAMP_S)

    def mend(self, row: Row) -> None:
        """Remove the cause; wait for restarted nodes, which might enable a drive by themselves."""
        self._mended = True
        row.mend(self)
        self.intruders.dismiss()
        self.await_restarted()

    def recovers(self, row: Row) -> bool:
        """End a row that failed, and return whether the next one can follow."""
        self._deadline = self.time + _ROW_S
        try:
            if not self._mended:
                self.mend(row)
            self.ready(row.mode)
        except Exception:
            return False
        return True

    # Processes -----------------------------------------------------------------------------

    def kill(self, node: str) -> None:
        """End a node with SIGKILL; simulated time stands still until it has ended."""
        self.graph.signal(node, signal.SIGKILL)
        self._await_end(node)

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

    def restart(self, node: str) -> None:
        """Start a node again, after waiting for its end."""
        self.clock.idle()
        self._await_end(node)
        self.forget(self.graph.nodes_of(node))
        self.graph.restart(node)
        self._restarted.add(node)

    def start_guest(self, node: str, *arguments: str) -> None:
        """Start one more process of an executable; return when it takes part in simulated time."""
        self._await_start(self.intruders.start(node, *arguments), f"the second {node}")

    def await_restarted(self) -> None:
        """Wait until the restarted nodes are active, and set their parameters."""
        if not self._restarted:
            return
        processes, self._restarted = self._restarted, set()
        for process in processes:
            self._await_start(self.graph.pids[process], process)
        nodes = {node for process in processes for node in self.graph.nodes_of(process)}
        self.wait_until_ready(nodes)
        for topic, owner in _ONE_SENDER.items():
            if owner in nodes:
                self._await_process(
                    lambda topic=topic: self.node.count_publishers(topic) <= 1,
                    f"the middleware does not drop the ended publisher of {topic}",
                )
        if nodes & {"impedance_controller", "manus"}:
            self.configure()
        if "sim_rig" in nodes:
            self.wait_until(lambda: self.record.fresh("sim_rig"), 5.0, "no sim/truth")
            self.hand.set_up()

    def creep_until(
        self, condition: Callable[[], object], seconds: float, still_ns: int = _CREEP_NS
    ) -> bool:
        """Wait for processes and the middleware, `seconds` of wall clock at most.

        Returns whether `condition` became true. Simulated time hardly advances: `_CREEP_S` each
        `still_ns` of wall clock [ns], less than the lock step's patience of 1 s.
        """
        now_ns = _WALL.now_ns()
        end_ns, step_ns = now_ns + round(seconds * 1e9), now_ns + still_ns
        while not condition():
            if now_ns > end_ns:
                return False
            _WALL.sleep_until(now_ns + _POLL_NS)
            now_ns = _WALL.now_ns()
            if now_ns >= step_ns and alive(self.clock.page.conductor):
                step_ns = now_ns + still_ns
                self._sleep_until(self.clock.now_ns() + round(_CREEP_S * 1e9))
        return True

    def _await_start(self, pid: int, name: str) -> None:
        page = self.clock.page
        self._await_process(lambda: pid in page.thread_pid, f"{name} does not start")

    def _await_process(self, condition: Callable[[], object], what: str) -> None:
        def watched() -> object:
            self.graph.watch()
            return condition()

        if not self.creep_until(watched, _STARTED_S):
            raise RobotError(what)

    def _await_end(self, node: str) -> None:
        """Wait by wall clock, with simulated time standing still."""
        end_ns = _WALL.now_ns() + round(_ENDED_S * 1e9)
        while self.graph.exit_code(node) is None:
            if _WALL.now_ns() > end_ns:
                raise RobotError(f"{node} did not end")
            _WALL.sleep_until(_WALL.now_ns() + _POLL_NS)

