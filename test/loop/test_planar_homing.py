# SPDX-License-Identifier: Apache-2.0
"""The plane's homing: torque off, twice where in doubt, anew when a position may have shifted."""

from __future__ import annotations

import struct

import can
import pytest

from screw_module_ros.control.slot import Slot
from screw_module_ros.devices import drive_group
from screw_module_ros.devices.errors import NotNow
from screw_module_ros.loop import gate
from screw_module_ros.safety.permit import CLOSED, OPENING


def homed_and_enabled(bench) -> bool:
    return bench.plane.take_home(bench.now_ns) == bench.enable_plane() == ""


def test_not_on_the_way_to_enabled(bench):
    bench.plane.drives.permit.phase = OPENING
    assert "disable it first" in bench.plane.take_home(bench.now_ns)
    bench.plane.drives.permit.phase = CLOSED
    assert bench.plane.take_home(bench.now_ns) == ""


def test_not_while_enabled(bench, plane):
    assert "disable it first" in plane.take_home(bench.now_ns)


def test_not_while_a_drive_is_in_operation_without_us(bench):
    """The gate is closed, the drive's own statusword says otherwise."""
    shoulder = bench.rig.devices["shoulder"]
    for controlword in (0x06, 0x07, 0x0F):
        shoulder.node.set_data(0x6040, 0, controlword.to_bytes(2, "little"))
    bench.ports["planar"].send_sync(bench.now_ns)
    bench.rig.process(bench.now_ns)
    bench.ports["planar"].pump()
    assert "disable it first" in bench.plane.take_home(bench.now_ns)


def test_elsewhere_it_must_be_asked_for_twice(bench):
    """The handle stands 5 cm from where the last homing says the mark is."""
    axes = bench.plane
    shoulder, elbow = axes.controller.joints
    shoulder.motion.home(shoulder.motion.position + 0.1)
    angles = shoulder.motion.position, elbow.motion.position
    refused = axes.take_home(bench.now_ns)
    assert "mm against the last homing" in refused and "again" in refused
    assert (shoulder.motion.position, elbow.motion.position) == angles, "nothing moved"
    assert not axes.controller.homed and "not homed" in bench.enable_plane()
    bench.ticks(500)
    assert "against" in axes.take_home(bench.now_ns), "too soon to be a second thought"
    bench.ticks(2000)
    assert axes.take_home(bench.now_ns) == ""
    assert abs(shoulder.motion.position - angles[0]) > 0.09
    assert axes.take_home(bench.now_ns) == "", "the same mark again"


def test_a_plane_that_was_left_starts_with_its_guards_and_without_a_home(bench):
    """Between deactivate and activate nobody listens: a drive may have restarted unseen."""
    axes = bench.plane
    ends = [bench.rig.devices[name].node for name in ("shoulder", "elbow")]

    def guards():
        return [(end.value(0x1400, 5), end.value(0x1016, 1)) for end in ends]

    assert axes.controller.homed
    axes.controller.guide.ask(Slot(target_y=0.14), 0, bench.now_ns)
    assert axes.drives.shutdown() == ""
    assert guards() == [(0, 0)] * 2
    axes.restart()
    assert axes.controller.guide.guidance(0.03, 0.0, 0.0, 0.0, bench.now_ns, 0.002).weight == 0.0
    drive_group.start(axes.drives.permit.drives)
    assert guards() == [(20, 113 << 16 | 100)] * 2
    assert axes.take_home(bench.now_ns) == "the drives do not answer"
    bench.ticks(30)
    assert not axes.controller.homed and "not homed" in bench.enable_plane()
    assert homed_and_enabled(bench)


def test_no_home_outlives_a_restart_whose_clearing_was_not_answered(bench, monkeypatch):
    """The drive counts anew, and nothing is left by which a second clearing would know it."""
    plane, cleared = bench.plane, gate.clear_fault

    def unanswered(permit, requests):
        cleared(permit, requests)
        raise NotNow("the loop does not run: activate the node")

    assert plane.controller.homed
    bench.rig.inject("shoulder", "reset", 0.0, 0.0, bench.now_ns)
    bench.ticks(200)
    with monkeypatch.context() as patch:
        patch.setattr(gate, "clear_fault", unanswered)
        with pytest.raises(NotNow):
            bench.clear_plane_fault()
    bench.ticks(200)
    assert bench.clear_plane_fault() == ""
    assert not plane.controller.homed and "not homed" in bench.enable_plane()


def test_a_drive_whose_communication_was_reset_must_be_homed(bench, plane):
    """It was told to begin anew; whether its count has outlived that, nobody knows."""
    bench.rig.inject("shoulder", "heartbeat_lost", 0.0, 0.0, bench.now_ns)
    bench.ticks(1000)
    bench.rig.inject("shoulder", "clear", 0.0, 0.0, bench.now_ns)
    before = plane.drives.pair[0].counters["boot_ups"]
    assert plane.controller.homed and bench.clear_plane_fault() == ""
    assert plane.drives.pair[0].counters["boot_ups"] > before
    assert not plane.controller.homed and "not homed" in bench.enable_plane()


def test_a_jump_costs_the_home_position(bench, plane):
    """clear_fault alone does not lead back to operation; home at the reference mark does."""
    bench.planar_setpoint = (0.05, 0.05, 0.0, 0.0)
    bench.rig.inject("shoulder", "garbage", 0.0, 0.0, bench.now_ns)
    bench.ticks(20)
    bench.rig.inject("shoulder", "clear", 0.0, 0.0, bench.now_ns)
    bench.ticks(200)
    assert not plane.controller.homed
    assert bench.clear_plane_fault() == ""
    assert "not homed" in bench.enable_plane()
    bench.ticks(2000)
    assert homed_and_enabled(bench)
    bench.ticks(600)
    assert max(map(abs, plane.drives.written)) > 0.1


HOME_OFFSET = 0x607C
"""Object by which a drive shifts the zero of its position (CiA 402)."""


@pytest.mark.parametrize("node_id", [3, 4])
def test_after_a_foreign_sdo_client_the_plane_must_be_homed_again(bench, node_id):
    """Shifted counts are no jump: the drive was silent while it was configured anew."""
    assert bench.plane.controller.homed
    data = struct.pack("<BHBi", 0x23, HOME_OFFSET, 0, 1000)
    with bench.buses["planar"].join() as intruder:
        request = can.Message(arbitration_id=0x600 + node_id, data=data, is_extended_id=False)
        intruder.send(request)
        bench.ticks(5)
        drives = bench.plane.drives.permit.drives
        assert any("another SDO client" in drive.fault for drive in drives)
        assert bench.clear_plane_fault() == ""
    assert not bench.plane.controller.homed
    assert "not homed" in bench.enable_plane()
    bench.ticks(50)
    assert homed_and_enabled(bench)
