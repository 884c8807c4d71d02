# SPDX-License-Identifier: Apache-2.0
"""A bus that fails for one drive of the plane takes neither the gate nor the other drive along."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest

from screw_module_ros.clock import ManualClock
from screw_module_ros.control import gate
from screw_module_ros.control.gate import GateSettings
from screw_module_ros.control.planar_settings import PlanarSettings
from screw_module_ros.devices.cia402 import State
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.devices.errors import BusError
from screw_module_ros.loop.joint import JointSettings
from screw_module_ros.loop.planar_axes import PlanarAxes
from screw_module_ros.samples import DriveReading

MS = 1_000_000
NOWHERE = (math.nan, math.nan, 0.0, 0.0)


class FakeDrive:
    """A drive in operation enabled whose SYNC or commands may fail."""

    fault, running, settings = "", False, DriveSettings()

    def __init__(self, label):
        self.label = label
        self.fails: set[str] = set()
        self.done: list[str] = []
        self.reading = DriveReading(0, 0x27, 0, 0.0)

    def _do(self, what):
        self.done.append(what)
        if what in self.fails:
            raise BusError(f"{self.label} {what}")

    def sync(self, now_ns):
        self._do("sync")

    def heartbeat(self, now_ns):
        self._do("heartbeat")

    def write(self, torque_nm, now_ns):
        self._do("write")
        return torque_nm

    def state(self, now_ns):
        return State.OPERATION_ENABLED

    def request_disable(self):
        self._do("disable")


@pytest.fixture
def axes():
    drives = (FakeDrive("shoulder drive"), FakeDrive("elbow drive"))
    made = PlanarAxes(drives, MS, PlanarSettings(), JointSettings(), GateSettings())
    made.drives.permit(True, "", 100 * MS)
    made.act(NOWHERE, 100 * MS)
    made.drives.gate = gate.GateState(gate.OPEN, 1.0, gate.PASSING, False, 1, 100 * MS)
    for drive in drives:
        drive.done.clear()
    return made


@pytest.mark.parametrize("failing", [0, 1])
def test_both_drives_are_written_whichever_fails(axes, failing):
    drives = axes.drives.drives
    drives[failing].fails.add("write")
    with pytest.raises(BusError, match=drives[failing].label):
        axes.act(NOWHERE, 101 * MS)
    assert [drive.done for drive in drives] == [["write"]] * 2
    assert len(axes.written) == 2


def test_the_first_error_is_the_one_raised(axes):
    for drive in axes.drives.drives:
        drive.fails.add("write")
    with pytest.raises(BusError, match="shoulder drive write"):
        axes.idle(101 * MS)


def test_the_heartbeat_goes_out_without_a_sync(axes):
    axes.drives.drives[0].fails.add("sync")
    with pytest.raises(BusError, match="sync"):
        axes.request(101 * MS)
    assert [drive.done[-1] for drive in axes.drives.drives] == ["heartbeat"] * 2


def test_after_the_end_the_gate_is_closed_and_the_next_start_finds_no_fault(axes):
    """Deactivated while enabled, activated again later: nothing is latched."""

    assert axes.drives.enabled
    assert axes.shutdown(SimpleNamespace(clock=ManualClock(102 * MS))) == ""
    assert not axes.drives.enabled and axes.drives.reason == "not enabled"
    axes.idle(9000 * MS)
    assert not axes.drives.faulted
