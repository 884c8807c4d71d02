# SPDX-License-Identifier: Apache-2.0
"""After a joint's position has jumped nobody knows where the plane is: it must be homed again."""

from __future__ import annotations


def test_a_jump_costs_the_home_position(bench):
    """clear_fault alone does not lead back to operation; home at the reference mark does."""
    bench.planar_setpoint = (0.05, 0.05, 0.0, 0.0)
    assert bench.enable_plane() == ""
    bench.rig.inject("shoulder", "garbage", 0.0, 0.0, bench.now_ns)
    bench.ticks(20)
    bench.rig.inject("shoulder", "clear", 0.0, 0.0, bench.now_ns)
    bench.ticks(200)
    assert not bench.plane.homed
    assert bench._asking(bench.plane.clear_fault) == ""
    assert "not homed" in bench.plane.enable(lambda seconds: None)
    bench.ticks(2000)
    assert bench.plane.take_home(bench.now_ns) == ""
    assert bench.enable_plane() == ""
    bench.ticks(600)
    assert max(map(abs, bench.plane.written)) > 0.1
