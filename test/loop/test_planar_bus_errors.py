# SPDX-License-Identifier: Apache-2.0
"""A bus that fails for one drive of the plane takes neither the gate nor the other drive along."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from screw_module_ros.clock import ManualClock
from screw_module_ros.control.planar_settings import PlanarSettings
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.devices.errors import BusError
from screw_module_ros.loop.plane import JointSettings, Plane
from screw_module_ros.safety.permit import OPEN, PermitSettings
from screw_module_ros.samples import DriveReading

MS = 1_000_000


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

    def is_on(self, now_ns):
        return True

    def request_disable(self):
        self._do("disable")


@pytest.fixture
def axes():
    drives = (FakeDrive("shoulder drive"), FakeDrive("elbow drive"))
    port = SimpleNamespace(clock=ManualClock(102 * MS))
    made = Plane(drives, port, MS, PlanarSettings(), JointSettings(), PermitSettings())
    made.permit.supervise(True, "", 100 * MS)
    made.act(100 * MS)
    made.permit.phase, made.permit.scale = OPEN, 1.0
    for drive in drives:
        drive.done.clear()
    return made


@pytest.mark.parametrize("failing", [0, 1])
def test_both_drives_are_written_whichever_fails(axes, failing):
    drives = axes.permit.drives
    drives[failing].fails.add("write")
    with pytest.raises(BusError, match=drives[failing].label):
        axes.act(101 * MS)
    assert [drive.done for drive in drives] == [["write"]] * 2
    assert len(axes.written) == 2


def test_the_first_error_is_the_one_raised(axes):
    for drive in axes.permit.drives:
        drive.fails.add("write")
    with pytest.raises(BusError, match="shoulder drive write"):
        axes.idle(101 * MS)


def test_the_heartbeat_goes_out_without_a_sync(axes):
    axes.permit.drives[0].fails.add("sync")
    with pytest.raises(BusError, match="sync"):
        axes.request(101 * MS)
    assert [drive.done[-1] for drive in axes.permit.drives] == ["heartbeat"] * 2


def test_after_the_end_the_gate_is_closed_and_the_next_start_finds_no_fault(axes):
    """Deactivated while enabled, activated again later: nothing is latched."""

    assert axes.permit.enabled
    assert axes.shutdown() == ""
    assert not axes.permit.enabled and axes.permit.reason == "not enabled"
    axes.idle(9000 * MS)
    assert not axes.permit.faulted
