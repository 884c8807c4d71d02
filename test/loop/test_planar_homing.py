# SPDX-License-Identifier: Apache-2.0
"""The plane's homing: only with the torque off, and twice where it contradicts the last one."""

from __future__ import annotations

from screw_module_ros.control.slot import Slot
from screw_module_ros.devices import drive_group
from screw_module_ros.safety.permit import CLOSED, OPENING


def test_not_while_enabled_nor_on_the_way_there(bench):
    permit = bench.plane.permit
    permit.phase = OPENING
    assert "disable it first" in bench.plane.take_home(bench.now_ns)
    permit.phase = CLOSED
    assert bench.plane.take_home(bench.now_ns) == ""
    assert bench.enable_plane() == ""
    assert "disable it first" in bench.plane.take_home(bench.now_ns)


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
    shoulder, elbow = axes.joints
    shoulder.motion.home(shoulder.motion.position + 0.1)
    angles = shoulder.motion.position, elbow.motion.position
    refused = axes.take_home(bench.now_ns)
    assert "mm against the last homing" in refused and "again" in refused
    assert (shoulder.motion.position, elbow.motion.position) == angles, "nothing moved"
    assert not axes.homed and "not homed" in bench.enable_plane()
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
    assert axes.homed
    axes.guide.ask(Slot(target_y=0.14), 0, bench.now_ns)
    assert axes.shutdown() == ""
    assert [(end.value(0x1400, 5), end.value(0x1016, 1)) for end in ends] == [(0, 0)] * 2
    axes.restart()
    assert axes.guide.guidance(0.03, 0.0, 0.0, 0.0, bench.now_ns, 0.002).weight == 0.0
    drive_group.start(axes.permit.drives)
    assert [(end.value(0x1400, 5), end.value(0x1016, 1)) for end in ends] == [
        (20, 113 << 16 | 100)
    ] * 2
    assert axes.take_home(bench.now_ns) == "the drives do not answer"
    bench.ticks(30)
    assert not axes.homed and "not homed" in bench.enable_plane()
    assert axes.take_home(bench.now_ns) == ""
    assert bench.enable_plane() == ""
