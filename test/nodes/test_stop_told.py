# SPDX-License-Identifier: Apache-2.0
"""A killed process stops the robot, and the supervisor's log says so in one line."""

from __future__ import annotations

import signal
import subprocess

import pytest
from screw_module_msgs.msg import ForceCommand, SafetyState

from screw_module_ros.graph import MODULE
from screw_module_ros.nodes.bringup import executable_path
from screw_module_ros.operator.robot import Robot, RobotError
from screw_module_ros.trials.runner import GraphRun

pytestmark = [pytest.mark.graph, pytest.mark.long]

LOST = "encoder: no message for more than 0.2 s"
AGAIN_S = 60.0  # of wall clock; the middleware drops a killed publisher after 20 s


@pytest.fixture
def log(tmp_path, monkeypatch):
    """Return what gives the lines of the supervisor in the nodes' logs, times left out."""
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path))

    def lines() -> list[str]:
        text = [line for file in tmp_path.glob("*.log") for line in file.read_text().splitlines()]
        return [line.partition("[supervisor]: ")[2] for line in text if "[supervisor]: " in line]

    return lines


@pytest.mark.parametrize(("shared", "victim"), [(None, "encoder"), (MODULE, "module")])
def test_a_killed_process_is_one_line_and_so_is_its_return(shared, victim, log):
    def stops() -> list[str]:
        return [line for line in log() if line.startswith("stopped")]

    def permitted() -> bool:
        try:
            robot.clear_amplifier()
            robot.trigger("supervisor/reset")
        except RobotError:  # refused as long as two nodes publish a state, one of them dead
            return False
        return (state := robot.state(SafetyState)) is not None and state.motion_permitted

    with GraphRun(shared=shared) as graph, Robot("operator", watch=graph.watch) as robot:
        graph.wait_until_ready(robot)
        robot.trigger("encoder/home")
        robot.set_mode(ForceCommand.IMPEDANCE)
        robot.permit()
        robot.enable()
        robot.pause(0.2)  # a stop is latched where the supervisor has heard of an enabled drive
        graph.signal(victim, signal.SIGKILL)
        robot.wait_until(stops, 30.0, "the stop is not told")
        robot.pause(5.0)
        (line,) = stops()
        assert LOST in line and line.endswith("~/reset, then enable the drives")
        assert (victim == "module") == ("force_sensor: no message" in line)

        command = [executable_path("bringup"), "--only", victim, *["--composed"] * bool(shared)]
        again = subprocess.Popen(command)
        try:
            robot.met_by_wall(permitted, AGAIN_S)
            robot.wait_until(lambda: "motion permitted again" in log(), 30.0, "not permitted")
        finally:
            again.terminate()
        assert again.wait(30.0) == 0
