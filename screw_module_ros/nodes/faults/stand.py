# SPDX-License-Identifier: Apache-2.0
"""One running graph on which the rows are carried out, one after the other.

`ready` brings the robot from whatever state to operation, by the documented way back only: home,
tare, clear_fault, reset, enable; `steps` tells which of these services it needed. The graph is not
started anew.
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
from screw_module_msgs.msg import (
    AmplifierState,
    ForceCommand,
    ImpedanceState,
    PlanarState,
    SafetyState,
)
from screw_module_msgs.srv import SetFixture
from std_srvs.srv import SetBool, Trigger

from screw_module_ros.devices.bus import BusSettings, open_bus

from .. import bringup
from ..support import qos
from ..support.graph_run import GraphRun
from ..support.isolation import BUSES, NODE_OF_BUS
from ..support.realtime import Inbox
from ..support.robot import Robot, RobotError, arm
from .listener import NO_JOINT_TORQUE, NO_TORQUE, Listener
from .ticks import PERIOD, slow_ticks

HOME = 0.25  # where the hand is and the reference mark is [m]
AMPLITUDE, OMEGA = (0.02, 0.02, 0.06), 3.0  # of the patient's hand [m], [rad/s]
SPRING = (0.05, 0.05, HOME + 0.06, 0.0, 0.0, 0.0)  # where the springs pull, so that torque is out
STIFFNESS, PLANE_STIFFNESS, PLANE_DAMPING = 100.0, 100.0, 10.0
FORCE_GAIN = 2.0
ARM_DAMPING = 40.0  # a hand that comes to rest [Ns/m]
_STILL = (0.0, 0.0, 0.0)
_LOWEST, _HIGHEST = 0.02, 0.33  # where the hand may rest [m]
_READY_S, _STEP_S, _SETTLE_S = 45.0, 0.05, 0.6
_TARE_AGAIN_S = 2.5
_AT_HOME, _RESTING, _RESTING_JOINT = 0.002, 0.004, 0.01
_AT_PLANE_HOME = 0.005  # the joints' stiction holds a soft hand 2 mm from its mark [m]
_REST_S, _RESTING_FORCE = 0.1, 0.3  # a hand that rests feels less change in this time [s], [N]
_ENDED_S = 12.0
_HOMING_S = 20.0  # a joint whose drive has lost its settings brakes
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
        self._context = Context()
        self._intruder: Node | None = None
        self.deadline = math.inf
        self.enabled_at = 0.0  # simulated time when `ready` began to enable [s]
        self._one_enabled = False
        self.mode = -1
        self.steps: set[str] = set()
        self._tared = 0.0
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
        self._set_patient()
        self.configure()

    def _set_patient(self) -> None:
        self.robot.set_arm(arm(kind="active", mass=3.0, stiffness=300.0, damping=ARM_DAMPING))

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
        """Return a function that takes the next message of a topic, None while there is none."""
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
        for bus in self._buses:
            bus.shutdown()
        for guest in self._guests:
            guest.stop()
        self._threads, self._publishers, self._buses, self._guests = [], [], [], []
        self._over.clear()

    # The patient ---------------------------------------------------------------------------

    def calm(self) -> None:
        """Let the patient's hand rest: at the reference mark, or where the handle has stopped."""
        self.heard.setpoint = SPRING
        (x, y), z = (0.0, 0.0), HOME
        if not (self.heard.enabled("amplifier") and self.heard.enabled("manus")):
            now = self.heard.now
            (x, y), z = now.plane, min(max(now.height, _LOWEST), _HIGHEST)
        self.robot.set_arm(
            arm((float(x), float(y), z), 0.2, amplitude=_STILL, omega=_STILL, kind="active")
        )

    def move(self) -> None:
        """Let the patient move the hand, and wait until torque is out."""
        self.robot.set_arm(
            arm(target=(0.0, 0.0, HOME), amplitude=AMPLITUDE, omega=(OMEGA,) * 3)
        )
        if not self.until(self.torque_out, 3.0):
            now = self.heard.now
            raise RobotError(
                f"no torque in motion: {now.torque:.3f} Nm, {now.speed:.3f} m/s, joints "
                f"{now.joints[0]:.2f} and {now.joints[1]:.2f} Nm{self.robot.complaints_text()}"
            )

    def torque_out(self) -> bool:
        """Return whether torque is out where the mode wants it, and the hand moves."""
        now = self.heard.now
        vertical = abs(now.torque) > NO_TORQUE or self.mode == ForceCommand.OFF
        plane = max(map(abs, now.joints)) > NO_JOINT_TORQUE
        return vertical and plane and abs(now.speed) > 1e-3

    def at_rest(self) -> bool:
        """Return whether the hand rests: what it feels from now on is the robot."""
        moments = self.heard.since(self.heard.now.time - _REST_S)
        forces = [moment.force for moment in moments]
        return bool(moments) and all(
            max(axis) - min(axis) < _RESTING_FORCE for axis in zip(*forces, strict=True)
        )

    def place(self, height: float = HOME) -> None:
        """Carry the handle to a height [m], as a technician does; the hand is there as well."""
        rest = (math.nan, math.nan, 0.0)
        self.robot.set_arm(arm((math.nan, math.nan, height), amplitude=rest, omega=rest))
        self.robot.ask(
            SetFixture,
            "sim_rig/set_fixture",
            SetFixture.Request(fixture="human_arm", position=height),
        )

        def there() -> bool:
            now = self.heard.now
            return abs(now.height - height) < _AT_HOME and abs(now.speed) < _RESTING

        if not self.robot.met(there, 5.0):
            now = self.heard.now
            raise RobotError(
                f"the handle does not come to {height:g} m: {now.height:.4f} m, {now.speed:.3f} m/s"
                f"{self.robot.complaints_text()}"
            )

    # The way back --------------------------------------------------------------------------

    def ready(self, mode: int) -> None:
        """Bring the robot to operation in `mode`, the hand at rest. Raises RobotError if stuck."""
        self.await_restarted()
        self.calm()
        end = time.monotonic() + _READY_S
        self.enabled_at, self._one_enabled = self.heard.now.time, False
        while missing := self._improve(mode):
            if time.monotonic() > end:
                raise RobotError(f"no way back to operation: {missing}")
            self.robot.pause(_STEP_S)

    def await_restarted(self) -> None:
        """Wait until the nodes that were started again are active, and set them up."""
        if not self._restarted:
            return
        nodes, self._restarted = self._restarted, set()
        self.robot.wait_until_ready(nodes)
        if nodes & {"impedance_controller", "manus"}:
            self.mode = -1
            self.configure()
        if "sim_rig" in nodes:
            self.robot.wait_until(lambda: self.heard.fresh("sim_rig"), 5.0, "no sim/truth")
            self._set_patient()

    def _improve(self, mode: int) -> str:
        """Do the next thing an operator would do; return what is missing, empty for nothing."""
        for step in (self._sensors, self._drives, self._permission):
            missing = step()
            if missing:
                return missing
        return self._operate(mode)

    def _sensors(self) -> str:
        robot, heard = self.robot, self.heard
        if not (heard.fresh("encoder") and heard.homed):
            self.place()
            return self._try(Trigger, "encoder/home")
        ill = any(
            told.startswith("force_sensor:") and "samples/s" not in told
            for told in robot.complaints()
        )
        if not heard.fresh("force_sensor") or ill:
            return self._tare() or "force_sensor: tared"
        return ""

    def _tare(self) -> str:
        """Let the handle go and tare; the diagnostics need a moment to say that all is well."""
        if time.monotonic() - self._tared < _TARE_AGAIN_S and self.heard.fresh("force_sensor"):
            return "force_sensor: its diagnostics still say so"
        self.robot.set_fixture("free")
        refused = self._try(Trigger, "force_sensor/tare")
        self.place()
        if not refused:
            self._tared = time.monotonic()
        return refused

    def _drives(self) -> str:
        robot = self.robot
        vertical, plane = robot.state(AmplifierState), robot.state(PlanarState)
        if vertical is None or plane is None:
            return f"{'amplifier' if vertical is None else 'manus'} is silent"
        if vertical.faulted:
            return self._try(Trigger, "amplifier/clear_fault") or vertical.reason
        if plane.faulted:
            return self._try(Trigger, "manus/clear_fault") or plane.reason
        if not plane.homed:
            still = arm((0.0, 0.0, math.nan), 0.2, amplitude=_STILL, omega=_STILL)
            self.robot.set_arm(still)
            if not self.robot.met(self._plane_at_home, _HOMING_S):
                now = self.heard.now
                raise RobotError(
                    f"the plane does not come to rest: {1e3 * math.hypot(*now.plane):.1f} mm from "
                    f"its mark, {now.joint_speed:.2g} rad/s{robot.complaints_text()}"
                )
            return self._try(Trigger, "manus/home") or "manus: homed"
        return ""

    def _plane_at_home(self) -> bool:
        now = self.heard.now
        return math.hypot(*now.plane) < _AT_PLANE_HOME and now.joint_speed < _RESTING_JOINT

    def _permission(self) -> str:
        state = self.robot.state(SafetyState)
        if state is None or state.level == SafetyState.OK:
            return "" if state else "the supervisor is silent"
        reasons = ", ".join(state.reasons)
        if state.level == SafetyState.STOPPED:
            return self._try(Trigger, "supervisor/reset") or reasons
        return reasons or "waiting"

    def _operate(self, mode: int) -> str:
        robot = self.robot
        controller = robot.state(ImpedanceState)
        if controller is None:
            return "impedance_controller is silent"
        if controller.mode != mode:
            robot.set_mode(mode)
        self.mode = mode
        silent = [node for node in ("amplifier", "manus") if not self.heard.fresh(node)]
        if silent:
            return f"{silent[0]} is silent"
        on = {node: self.heard.enabled(node) for node in ("amplifier", "manus")}
        if not all(on.values()):
            if not self.at_rest():
                return "the hand moves"
            if not self._one_enabled:
                self.enabled_at = self.heard.now.time
            for node, is_on in on.items():
                refused = "" if is_on else self._try(SetBool, f"{node}/enable", data=True)
                if refused:
                    return refused
                self._one_enabled = True
            return "just enabled"
        settled = self.heard.now.time - self.enabled_at > _SETTLE_S
        return "" if settled and controller.mode == mode else "settling"

    def _try(self, kind: type, service: str, **fields: Any) -> str:
        """Call a service; return what it said when it refused, else empty."""
        try:
            answer = self.robot.call(kind, service, kind.Request(**fields), 6.0)
        except RobotError as error:
            self._watch()
            return str(error)
        if answer.success:
            self.steps.add(service)
            return ""
        return answer.message or "refused"

    def until(self, condition: Callable[[], Any], deadline_s: float) -> bool:
        """Wait for a condition; return whether it came true in time."""
        return self.robot.met(condition, deadline_s)
