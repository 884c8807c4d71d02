# SPDX-License-Identifier: Apache-2.0
"""Two robots in two namespaces of one ROS domain, each with its own buses, time and bag.

One bridge serves both, and one therapist's page shows both, in a browser.
"""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import pytest
from browser_pages import opened, start_on
from screw_module_msgs.msg import AmplifierState, ForceCommand, SafetyState, TherapyState

from screw_module_ros.bridge.tokens import tokens_in
from screw_module_ros.graph import MODULE
from screw_module_ros.lockstep.page import sweep
from screw_module_ros.nodes import bringup
from screw_module_ros.operator.robot import Robot, RobotError
from screw_module_ros.recording.decoded import topics
from screw_module_ros.recording.records import notes
from screw_module_ros.recording.verify import verify

pytestmark = [pytest.mark.graph, pytest.mark.long]

NAMES = ("left", "right")
ONE_ROBOT = ["sim_rig", "supervisor", "module", "endpoint_state", "session_recorder"]
PARTS = ["encoder", "force_sensor", "impedance_controller", "amplifier"]
SESSION, BRIDGE = "therapy_session", "web_bridge"
NODES = ["sim_rig", "supervisor", *PARTS, "endpoint_state", "session_recorder", SESSION]
SILENT = "the therapist's page has been silent for 2 s"


class Operator:
    """One robot's operator: hears its session."""

    def __init__(self, robot):
        self.robot = robot
        self.states: list[TherapyState] = []
        self.is_homed = False
        robot.node.create_subscription(TherapyState, "therapy/state", self._hear, 10)

    def _hear(self, state):
        self.states = [*self.states[-5:], state]

    def make_ready(self):
        """Have the robot homed, permitted and enabled, whatever was before."""
        robot = self.robot
        robot.enable(False)
        robot.clear_amplifier()
        if not self.is_homed:  # once: a session leaves the nut elsewhere than at its mark
            robot.trigger("encoder/home")
            self.is_homed = True
        robot.set_mode(ForceCommand.IMPEDANCE)
        robot.trigger("supervisor/reset")
        robot.wait_until(
            lambda: (state := robot.state(SafetyState)) and state.motion_permitted, 30.0,
            "no permission",
        )  # fmt: skip
        robot.enable()

    def until_paused(self, reason):
        self.robot.wait_until(
            lambda: self.states and self.states[-1].state == TherapyState.PAUSED
            and reason in self.states[-1].reason,
            60.0, f"the session does not pause: {reason}",
        )  # fmt: skip


@pytest.fixture(scope="module")
def bags(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("bags")


@pytest.fixture(scope="module")
def started(bags, tmp_path_factory, ros_domain_id):
    """Return the operators by name, the bridge's address, and its tokens.

    The operators take no part in the simulated times: one thread cannot keep up with two of them.
    """
    tokens = tmp_path_factory.mktemp("bridge") / "state" / "tokens.json"
    extra = ["-p", f"supervisor:required:=[{', '.join(PARTS)}]",
             "-p", f"session_recorder:folder:={bags}"]  # fmt: skip
    processes: list[bringup.Process] = []

    def watch():
        for process in processes:
            if process.exit_code() is not None:
                raise RobotError(f"{process.name} ended by itself")

    try:
        for name in NAMES:
            processes += bringup.start(
                namespace=name, only=ONE_ROBOT, shared=MODULE, extra=extra
            )
            simulated = ["-p", "use_sim_time:=true", "-r", f"__ns:=/{name}"]
            processes.append(bringup.Process(SESSION, ["--ros-args", *simulated]))
        bridge = ["-p", "robots:=[left, right]", "-p", "port:=0", "-p", f"token_file:={tokens}"]
        processes.append(bringup.Process(BRIDGE, ["--ros-args", *bridge]))
        with ExitStack() as stack:
            found = {name: Operator(stack.enter_context(Robot("tester", name, watch)))
                     for name in NAMES}  # fmt: skip
            watcher = stack.enter_context(Robot("watcher", watch=watch))
            for operator in found.values():
                operator.robot.wait_until_ready(NODES)
            watcher.wait_until_ready([BRIDGE])
            watcher.wait_until(lambda: "http://" in watcher.said(BRIDGE), 30.0, "no address")
            yield found, watcher.said(BRIDGE).rpartition(" ")[2], tokens_in(tokens)
    finally:
        codes = [process.stop() for process in reversed(processes)]
        sweep(str(ros_domain_id))
    assert set(codes) == {0}


def test_each_has_the_values_of_the_file(started):
    for operator in started[0].values():
        robot = operator.robot
        encoder = robot.parameters("encoder", ("home_position", "can.channel", "use_sim_time"))
        assert encoder == {"home_position": 0.25, "can.channel": "encoder", "use_sim_time": True}
        assert robot.parameters("amplifier", ["module_serial"]) == {"module_serial": "SIM-0001"}
        rig = robot.parameters("sim_rig", ["devices.command_latency"])
        assert rig == {"devices.command_latency": 0.3e-3}  # composed


def test_what_one_does_the_other_does_not(started):
    """Enabled, stopped and recorded one by one; each bag holds its own robot alone."""
    robots = {name: operator.robot for name, operator in started[0].items()}
    for operator in started[0].values():
        operator.make_ready()
    folders = {name: Path(robot.trigger("session_recorder/start"))
               for name, robot in robots.items()}  # fmt: skip
    assert folders["left"] != folders["right"]
    left, right = robots.values()
    left.trigger("supervisor/estop")
    left.wait_until(lambda: not left.newest(AmplifierState).enabled, 20.0, "left is not stopped")
    right.pause(0.5)
    assert right.newest(AmplifierState).enabled
    assert right.newest(SafetyState).level == SafetyState.OK
    for name, robot in robots.items():
        wanted = {f"/{name}/{node}" for node in NODES}
        robot.wait_until(
            lambda folder=folders[name], wanted=wanted: wanted <= set(
                notes(folder).get("parameters", {})
            ), 30.0, "the recorder knows not every node",
        )  # fmt: skip
        robot.trigger("session_recorder/stop")
        found = set(topics(folders[name]))
        own = {f"/{name}/{topic}" for topic in ("screw/encoder", "handle/force", "safety_state",
                                                "screw/force_command", "sim/truth", "clock")}
        assert own <= found
        assert not [topic for topic in found if topic.startswith(("/left", "/right"))
                    and not topic.startswith(f"/{name}/")]  # fmt: skip
        asked = notes(folders[name])["parameters"]
        assert {node.split("/")[1] for node in asked} == {name}
        assert verify(folders[name]).complete, verify(folders[name]).problems


def test_each_robot_is_treated_and_stopped_by_itself(started, browser):
    operators, address, tokens = started
    for operator in operators.values():
        operator.make_ready()
    errors: list[str] = []
    page = opened(browser, f"{address}/therapist#token={tokens['therapist']}", errors, (1400, 900))
    left, right = page.locator("#robot-left"), page.locator("#robot-right")
    left.get_by_text("The torque is off: plane.").wait_for()  # these robots have no plane

    start_on(left, "elevator")
    left.get_by_text("Running, movement 1 of").wait_for()
    assert right.get_by_text("No session").is_visible()
    start_on(right, "elevator")
    right.get_by_text("Running, movement 1 of").wait_for()
    names = {name: operator.states[-1].patient for name, operator in operators.items()}
    assert len(set(names.values())) == 2, "each has its own patient"

    left.get_by_role("button", name="Pause").click()
    left.get_by_text("Paused, movement 1 of").wait_for()
    assert operators["right"].states[-1].state == TherapyState.RUNNING
    left.get_by_role("button", name="Resume").click()
    left.get_by_text("Running, movement 1 of").wait_for()

    screen = opened(browser, f"{address}/patient?robot=/right#token={tokens['patient']}", errors)
    screen.locator("body[data-shown=vertical]").wait_for()

    left.get_by_role("button", name="Software stop (not the emergency stop)").click()
    left.get_by_text("The robot has stopped: the software stop was asked for").wait_for()
    operators["left"].until_paused("the robot's safety monitor permits no motion")
    robot = operators["left"].robot  # its states come 100 times a second
    robot.wait_until(lambda: not robot.newest(AmplifierState).enabled, 5.0, "the torque stays on")
    assert operators["right"].robot.newest(AmplifierState).enabled
    assert operators["right"].states[-1].state == TherapyState.RUNNING
    assert right.get_by_text("The robot has stopped:").count() == 0

    page.close()
    operators["right"].until_paused(SILENT)
    assert errors == []
    screen.close()
