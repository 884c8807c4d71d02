# SPDX-License-Identifier: Apache-2.0
"""Two robots in two namespaces of one ROS domain, each with its own buses, time and bag."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import pytest
from screw_module_msgs.msg import AmplifierState, SafetyState

from screw_module_ros.lockstep.page import sweep
from screw_module_ros.nodes import bringup
from screw_module_ros.operator.robot import Robot, RobotError
from screw_module_ros.recording.decoded import topics
from screw_module_ros.recording.records import notes
from screw_module_ros.recording.verify import verify

pytestmark = [pytest.mark.graph, pytest.mark.long]

NAMES = ("left", "right")
ONE_ROBOT = ["sim_rig", "supervisor", "module", "session_recorder"]
NODES = ["sim_rig", "supervisor", "encoder", "force_sensor", "impedance_controller",
         "amplifier", "session_recorder"]  # fmt: skip
PLANE_IS_NOT_NEEDED = (
    "supervisor:required:=[encoder, force_sensor, impedance_controller, amplifier]"
)


@pytest.fixture(scope="module")
def bags(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("bags")


@pytest.fixture(scope="module")
def robots(bags, ros_domain_id):
    """Return an operator of each robot, both robots ready; all must end in good order.

    The operators take no part in the simulated times: one thread cannot keep up with two of them.
    """
    processes: dict[str, list[bringup.Process]] = {}
    codes: list[int] = []

    def watch() -> None:
        for name, started in processes.items():
            for process in started:
                if process.exit_code() is not None:
                    raise RobotError(f"{name}/{process.name} ended by itself")

    try:
        for name in NAMES:
            extra = ["-p", PLANE_IS_NOT_NEEDED, "-p", f"session_recorder:folder:={bags}"]
            processes[name] = bringup.start(
                namespace=name, only=ONE_ROBOT, extra=extra, composed=True
            )
        with ExitStack() as stack:
            found = {
                name: stack.enter_context(Robot("tester", name, watch))
                for name in NAMES
            }
            for robot in found.values():
                robot.wait_until_ready(NODES)
            yield found
    finally:
        for started in processes.values():
            codes += bringup.stop(started).values()
        sweep(str(ros_domain_id))
    assert set(codes) == {0}


def test_each_has_the_values_of_the_file(robots):
    for robot in robots.values():
        encoder = robot.parameters("encoder", ("home_position", "can.channel", "use_sim_time"))
        assert encoder == {"home_position": 0.25, "can.channel": "encoder", "use_sim_time": True}
        assert robot.parameters("amplifier", ["module_serial"]) == {"module_serial": "SIM-0001"}
        rig = robot.parameters("sim_rig", ["devices.command_latency"])
        assert rig == {"devices.command_latency": 0.3e-3}  # composed


def test_what_one_does_the_other_does_not(robots, bags):
    """Homed, enabled, stopped and recorded one by one; each bag holds its own robot alone."""
    folders = {}
    for robot in robots.values():
        robot.clear_amplifier()
        robot.trigger("encoder/home")
        robot.trigger("supervisor/reset")
        robot.wait_until(
            lambda robot=robot: (s := robot.state(SafetyState)) and s.motion_permitted,
            20.0,
            "no permission",
        )
    left, right = robots.values()
    for name, robot in robots.items():
        folders[name] = Path(robot.trigger("session_recorder/start"))
    assert folders["left"] != folders["right"]
    left.enable()
    right.enable()
    left.trigger("supervisor/estop")
    left.wait_until(lambda: not left.newest(AmplifierState).enabled, 20.0, "left is not stopped")
    right.pause(0.5)
    assert right.newest(AmplifierState).enabled
    assert right.newest(SafetyState).level == SafetyState.OK
    for name, robot in robots.items():
        robot.pause(1.5)  # the recorder looks for topics once a second
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
