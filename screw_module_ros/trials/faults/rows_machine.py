# SPDX-License-Identifier: Apache-2.0
"""Rows about the computer: disk, bag, clock, start order."""

from __future__ import annotations

import resource
import shutil
from collections.abc import Iterator
from pathlib import Path

from screw_module_msgs.msg import EndpointSetpoint

from screw_module_ros import graph

from .acts import both, called, published
from .patient import SPRING
from .row import Act, Alarm, Row
from .rows_operator import goes_on

_DRIVERS = ("encoder", "force_sensor", "impedance_controller", "amplifier", "manus")
_ENDING = 100  # samples until SIGTERM has reached all nodes
_BAG_LIMIT = 200_000  # [B]


def rows() -> Iterator[Row]:
    """Return the rows of disk, bag, clock, and a start in the wrong order."""
    yield goes_on("disk-full-while-recording", "the disk is full while recording", _disk_full,
                   "session_recorder", _disk_again)._replace(
        group="machine", alarm=Alarm("session_recorder", "File too large|No space"),
        recovery="make room, start again",
        watch=0.5)  # fmt: skip
    yield goes_on("bag-deleted-while-recording", "the bag's folder is deleted while recording",
                   _delete_bag, "session_recorder", _disk_again)._replace(
        group="machine", alarm=Alarm("session_recorder", "No such file"),
        recovery="start again", watch=0.5)  # fmt: skip
    yield goes_on("clock-jump", "set points with stamps of another year",
                   both(_stamped(4_000_000_000), _stamped(1)),
                   "no node: only the arrival time counts")._replace(group="machine")  # fmt: skip
    yield Row(
        name="bring-up-in-reverse", group="machine",
        fault="supervisor, drivers and controllers stopped in motion, started in the wrong order",
        inject=_stop_all, back=_start_in_reverse, alarm=None,
        recovery="home, tare, clear_fault, reset, enable", noticed_by="all of them",
        within=_ENDING, plane_within=_ENDING, apart=True,
    )  # fmt: skip


def _recording(testbed) -> Path:
    return testbed.robot.start_recording()


def _disk_full(testbed) -> None:
    _recording(testbed)
    testbed.robot.pause(0.3)
    _limit_files(testbed, _BAG_LIMIT)


def _limit_files(testbed, size: int) -> None:
    resource.prlimit(
        testbed.graph.pid("session_recorder"), resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY)
    )


def _disk_again(testbed) -> None:
    """Make room again, stop the recording, and check that a new one works."""
    _limit_files(testbed, resource.RLIM_INFINITY)
    called("session_recorder/stop")(testbed)
    folder = _recording(testbed)
    testbed.robot.pause(0.3)
    testbed.robot.stop_recording()
    shutil.rmtree(folder)


def _delete_bag(testbed) -> None:
    shutil.rmtree(_recording(testbed))


def _stamped(second: int) -> Act:
    """Publish set points that are valid except for their stamp."""
    x, y, z, *_ = SPRING
    return published(
        EndpointSetpoint, graph.SETPOINT, 20, 0.005, header__stamp__sec=second,
        position__x=x, position__y=y, position__z=z,
    )  # fmt: skip


def _stop_all(testbed) -> float:
    begin = testbed.listener.time
    for node in ("supervisor", *_DRIVERS):
        testbed.terminate(node)
    return begin


def _start_in_reverse(testbed) -> None:
    for node in (*reversed(_DRIVERS), "supervisor"):
        testbed.restart(node)
