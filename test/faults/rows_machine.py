# SPDX-License-Identifier: Apache-2.0
"""Rows about the computer: disk, bag, clock, start order."""

from __future__ import annotations

import resource
import shutil
import subprocess
import sys
from pathlib import Path

from acts import both, called, published
from fault_robot import SPRING
from row import CLEAR, HOME, MODE, PLANE_BACK, TARE, Act, Report, Row, goes_on
from screw_module_msgs.msg import EndpointSetpoint

from screw_module_ros import graph
from screw_module_ros.graph import MODULE
from screw_module_ros.recording.verify import verify

GROUP = "machine"
_DRIVERS = ("encoder", "force_sensor", "impedance_controller", "amplifier", "manus")
_ENDING = 100  # samples until SIGTERM has reached all nodes
_BAG_LIMIT = 200_000  # [B]
_RECORDER = "session_recorder"


def _limit_files(robot, size: int) -> None:
    limits = (size, resource.RLIM_INFINITY)
    resource.prlimit(robot.graph.pids[_RECORDER], resource.RLIMIT_FSIZE, limits)


def _disk_full(robot) -> None:
    robot.start_recording()
    robot.pause(0.3)
    _limit_files(robot, _BAG_LIMIT)


def _disk_has_room(robot) -> None:
    """Make room again: the same recording goes on, and nothing is missing in its bag."""
    _limit_files(robot, resource.RLIM_INFINITY)
    robot.pause(1.0)
    assert "; " not in (told := robot.stop_recording()), told
    folder = Path(told.partition(": ")[0])
    report = verify(folder)
    counts = report.topics["/screw/encoder"]
    assert (counts.lost, counts.missed, counts.dropped) == (0, 0, 0), report.problems
    assert counts.messages > 1500, "of 0.3 s before, 0.5 s during and 1 s after it"
    shutil.rmtree(folder)


def _record_again(robot) -> None:
    """Stop the recording, and check that a new one works."""
    called(f"{_RECORDER}/stop")(robot)
    folder = robot.start_recording()
    robot.pause(0.3)
    robot.stop_recording()
    shutil.rmtree(folder)


def _stamped(second: int) -> Act:
    """Publish set points that are valid except for their stamp."""
    x, y, z, *_ = SPRING
    return published(
        EndpointSetpoint, graph.SETPOINT, 20, 0.005, header__stamp__sec=second,
        position__x=x, position__y=y, position__z=z,
    )  # fmt: skip


def _stop_all(robot) -> float:
    begin = robot.time
    for node in ("supervisor", *_DRIVERS):
        robot.terminate(node)
    return begin


def _start_in_reverse(robot) -> None:
    for node in (*reversed(_DRIVERS), "supervisor"):
        robot.restart(node)


def _check_hardware(robot) -> None:
    """Run the command beside the robot: it must touch nothing, and say why it only listens."""
    start = "from screw_module_ros.hardware.command import command; command()"
    words = [sys.executable, "-c", start, "--simulation", "--move", "0", "--seconds", "0"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        while process.poll() is None:  # until the row's deadline
            robot.pause(0.05)
        said = process.stdout.read()
    assert said.count(" is in use: a node drives ") == len(graph.BUSES), said


ROWS = [
    goes_on("check_hardware-beside", GROUP, "check_hardware is run beside the moving robot",
            _check_hardware, "check_hardware: it only listens to a bus in use", watch=0.3),
    goes_on("disk-full-while-recording", GROUP, "the disk is full for a while", _disk_full,
            _RECORDER, _disk_has_room, watch=0.5)._replace(
        report=Report(_RECORDER, "File too large|No space"), shared=MODULE),
    goes_on("bag-deleted-while-recording", GROUP, "the bag's folder is deleted while recording",
            lambda robot: shutil.rmtree(robot.start_recording()), _RECORDER, _record_again,
            watch=0.5)._replace(report=Report(_RECORDER, "No such file")),
    goes_on("clock-jump", GROUP, "set points with stamps of another year",
            both(_stamped(4_000_000_000), _stamped(1)), "no node: only the arrival time counts",
            watch=0.3),
    Row("bring-up-in-reverse", GROUP, "supervisor, drivers and controllers stopped in motion, "
        "started in the wrong order", _stop_all, None, (HOME, TARE, MODE, CLEAR, *PLANE_BACK),
        "all of them", _ENDING, _ENDING, mend=_start_in_reverse, shared=None),
]  # fmt: skip
