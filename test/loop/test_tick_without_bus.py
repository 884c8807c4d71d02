# SPDX-License-Identifier: Apache-2.0
"""A tick of a drive on a bus that fails: gate and writes get their turn all the same."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from screw_module_ros.clock import ManualClock
from screw_module_ros.control.gate import GateSettings
from screw_module_ros.control.torque_chain import TorqueChain
from screw_module_ros.devices.errors import BusError
from screw_module_ros.loop.drive import VerticalDrive
from screw_module_ros.loop.plane import PlaneLimits, PlaneLoop, PlaneWires
from screw_module_ros.loop.ticker import Tick

MS = 1_000_000


def fails(*_):
    raise BusError("the cable is out")


@pytest.mark.parametrize("failing", ["request", "pump"])
def test_an_error_before_the_writes_does_not_skip_them(failing):
    idle = []
    axes = SimpleNamespace(
        request=fails if failing == "request" else lambda now: None,
        answered=lambda since: False,
        idle=idle.append,
        drives=SimpleNamespace(missed=lambda in_a_row, limit: None),
    )
    port = SimpleNamespace(pump=fails, clock=ManualClock(5 * MS))
    PlaneLoop(axes, port, MS, PlaneLimits(), PlaneWires()).step()
    assert idle == [6 * MS]


def test_the_vertical_drive_is_no_other():
    idle = []
    port = SimpleNamespace(pump=fails, clock=ManualClock(5 * MS))
    drive = VerticalDrive(SimpleNamespace(), port, MS, GateSettings(), TorqueChain())
    drive.idle = idle.append
    drive.end_tick(Tick(1, 5 * MS, 6 * MS, 0), lambda drives, now_ns: None)
    assert idle == [5 * MS]
