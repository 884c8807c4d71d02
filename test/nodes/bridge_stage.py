# SPDX-License-Identifier: Apache-2.0
"""The whole graph with session, bridge and a simulated patient, for tests that are its pages."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import aiohttp
import yaml
from screw_module_msgs.msg import EndpointSetpoint, ForceCommand, SafetyState, TherapyState

from screw_module_ros.bridge.tokens import tokens_in
from screw_module_ros.graph import WHOLE
from screw_module_ros.nodes import bringup
from screw_module_ros.operator.bring_up import bring_up
from screw_module_ros.operator.robot import Robot, arm
from screw_module_ros.resources import resource_path
from screw_module_ros.terminal import Console
from screw_module_ros.trials.runner import GraphRun
from screw_module_ros.trials.therapy import make_ready

SESSION, BRIDGE = "therapy_session", "web_bridge"
DEADLINE_S = 400.0
QUICK = arm(patient="healthy", traits={"reach_time": 0.4})
PATIENT = "P-7K3QX"
PROTOCOL = "quick.yaml"
MOVEMENTS = 8


def write_protocol(folder: Path) -> None:
    """Write a circuit of the clock game without assistance, smaller and quicker."""
    content = yaml.safe_load(resource_path("params/therapy/clock_adaptive.yaml").read_text())
    targets = {"layout": "clock", "count": 4, "distance": 0.06}
    content["blocks"] = [{**content["blocks"][0], "circuits": 1, "targets": targets}]
    content["name"], content["title"] = "quick", "Quick clock"
    content["rules"].update(
        hit_radius=0.02, wait=0.5, give_up=4.0, hold=0.1, settle_time=0.05, prepare_duration=0.7
    )
    (folder / PROTOCOL).write_text(yaml.safe_dump(content))


class Stage:
    """Everything runs from entering to leaving; a thread is the operator and the patient."""

    def __init__(self, folder: Path, port: int = 0, extra: Sequence[str] = ()):
        self._extra = extra
        write_protocol(folder)
        self.folder = folder
        self.states: list[TherapyState] = []
        self.setpoints: list[EndpointSetpoint] = []
        self._given: queue.SimpleQueue[tuple[Callable, Future]] = queue.SimpleQueue()
        self._ready: Future = Future()
        self._ending = threading.Event()
        self._token_file = folder / "state" / "tokens.json"

    def __enter__(self) -> Stage:
        self.graph = GraphRun(extra=self._extra, shared=WHOLE)
        self.graph.__enter__()
        common = ["--ros-args", *self.graph.arguments("endpoint_state")]
        folder = ["-p", f"folder:={self.folder}"]
        self.session = bringup.Process(SESSION, [*common, *folder])
        self._bridge_arguments = [
            *common, *folder, "-p", f"token_file:={self._token_file}", "-p", "wishes:=true",
            "-p", f"recordings:={self.folder}",
        ]  # fmt: skip
        self.bridge = bringup.Process(BRIDGE, [*self._bridge_arguments, "-p", "port:=0"])
        self._thread = threading.Thread(target=self._operate, daemon=True)
        self._thread.start()
        try:
            self._ready.result(DEADLINE_S)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join(DEADLINE_S)
        self.codes = bringup.stop([self.session, self.bridge])
        self.graph.__exit__()

    @property
    def tokens(self):
        return tokens_in(self._token_file)

    def page_of(self, role: str) -> str:
        """Return the address of a role's page."""
        return f"{self.address}/{role}#token={self.tokens[role]}"

    def ask(self, act: Callable[[Robot], Any]) -> Any:
        """Let the operator do something; return or raise what came of it."""
        future: Future = Future()
        self._given.put((act, future))
        return future.result(DEADLINE_S)

    def wait_for_state(self, wanted: int, reason: str = "") -> None:
        """Wait until the session says so."""
        def there(robot: Robot) -> None:
            robot.wait_until(
                lambda: self.states and self.states[-1].state == wanted
                and reason in self.states[-1].reason,
                60.0, f"the session does not come to {wanted} {reason}",
            )  # fmt: skip

        self.ask(there)

    def restart_bridge(self) -> None:
        """Start the bridge that has ended again, on the same port."""
        port = self.address.rpartition(":")[2]
        self.bridge = bringup.Process(BRIDGE, [*self._bridge_arguments, "-p", f"port:={port}"])
        self.ask(lambda robot: robot.wait_until_ready([BRIDGE]))

    def play(self, follows: bool) -> None:
        """Let the patient move his hand where he is asked to, or not."""
        traits = {"follows": float(follows)}
        self.ask(lambda robot: robot.set_arm(arm(traits=traits)))

    def switch_on(self) -> None:
        """Reset what stopped the robot and switch the torque on again."""
        self.ask(lambda robot: bring_up(robot, ForceCommand.FORCE_FEEDBACK, self.hand))

    # The operator's thread -----------------------------------------------------------------

    def _operate(self) -> None:
        try:
            with Robot("operator", watch=self.graph.watch, simulated=True) as robot:
                self._begin(robot)
                while not self._ending.is_set():
                    self._do_what_was_given(robot)
                    robot.pause(0.02)
        except BaseException as error:
            if not self._ready.done():
                self._ready.set_exception(error)
            raise

    def _begin(self, robot: Robot) -> None:
        robot.wait_until_ready([*self.graph.names, SESSION, BRIDGE])
        robot.node.create_subscription(TherapyState, "therapy/state", self._hear, 50)
        robot.node.create_subscription(EndpointSetpoint, "setpoint", self.setpoints.append, 50)
        self.hand = make_ready(robot, Console(quiet=True), QUICK)
        robot.wait_until(lambda: self.states, 10.0, "the session is silent")
        said = robot.said(BRIDGE)
        robot.wait_until(lambda: "http://" in robot.said(BRIDGE), 10.0, f"the bridge says: {said}")
        self.address = robot.said(BRIDGE).rpartition(" ")[2]
        self._ready.set_result(None)

    def _hear(self, state: TherapyState) -> None:
        self.states = [*self.states[-20:], state]

    def _do_what_was_given(self, robot: Robot) -> None:
        try:
            act, future = self._given.get_nowait()
        except queue.Empty:
            return
        try:
            future.set_result(act(robot))
        except Exception as error:
            future.set_exception(error)


class Page:
    """A page as a program: a websocket with a token, as `async with`."""

    def __init__(self, address: str, token: str):
        self._url = f"{address}/ws?token={token}"
        self._calls = 0

    async def __aenter__(self) -> Page:
        self._session = aiohttp.ClientSession()
        self.socket = await self._session.ws_connect(self._url)
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._session.close()

    async def send(self, **content: Any) -> None:
        await self.socket.send_json(content)

    async def until(self, wanted: Callable[[dict], bool]) -> dict:
        """Return the first message that is wanted."""
        while True:
            message = await self.socket.receive_json(timeout=DEADLINE_S)
            if wanted(message):
                return message

    async def call(self, service: str, **arguments: Any) -> dict:
        """Call a service; return the answer."""
        self._calls += 1
        id = f"call {self._calls}"
        await self.send(op="call_service", service=service, args=arguments, id=id)
        return await self.until(lambda message: message.get("id") == id)

    async def attend(self) -> None:
        await self.send(op="publish", topic="/therapy/attendance", msg={})


def stopped(robot: Robot) -> bool:
    """Return whether the supervisor has stopped the robot."""
    state = robot.state(SafetyState)
    return state is not None and state.level == SafetyState.STOPPED and state.estopped
