# SPDX-License-Identifier: Apache-2.0
"""A planar drive whose position stands still: found out in motion, never suspected at rest."""

from __future__ import annotations

import math

import pytest

from screw_module_ros.plant.world import ArmSettings

pytestmark = pytest.mark.long


RELAXED = ArmSettings(kind="relaxed")
STRETCHED = ArmSettings(kind="active", target=(-0.06, -0.05, 0.25), duration=0.5)
SWINGING = ArmSettings(kind="active", amplitude=(0.08, 0.06, 0.0), omega=(5.0, 4.0, 0.0))


def moved(bench, arm, aim, seconds, frozen=None):
    """Return the reason of a plane some time after a joint's position has frozen."""
    bench.world.set_arm(arm)
    assert bench.enable_plane() == ""
    bench.seconds(0.5)
    if frozen:
        bench.rig.inject(frozen, "position_freeze", 0.0, 0.0, bench.now_ns)
    bench.plane.controller.settings = bench.plane.controller.settings._replace(stiffness=200.0)
    bench.planar_setpoint = (*aim, 0.0, 0.0)
    bench.seconds(seconds)
    return bench.plane.drives.permit.reason


@pytest.mark.parametrize(("joint", "aim"), [("shoulder", (0.09, 0.08)), ("elbow", (0.0, -0.12))])
def test_a_spring_that_runs_away_on_a_frozen_joint_is_stopped(bench, joint, aim):
    """The arm hangs in the handle; the set point is 12 cm away and never comes nearer."""
    assert f"{joint} drive: position (6064)" in moved(bench, RELAXED, aim, 1.0, joint)
    assert not bench.plane.drives.permit.enabled
    assert bench.plane.drives.written == (0.0, 0.0) and not bench.plane.controller.homed


def test_a_patient_who_moves_a_frozen_joint_is_noticed(bench):
    reason = moved(bench, SWINGING, (math.nan, math.nan), 0.8, "shoulder")
    assert "shoulder drive: position (6064)" in reason


@pytest.mark.parametrize("arm", [RELAXED, STRETCHED, SWINGING])
def test_healthy_joints_are_not_doubted(bench, arm):
    """At rest, held away from the set point against 10 N, and in motion with its turning points."""
    assert moved(bench, arm, (0.03, 0.05), 1.2) == ""
    assert bench.plane.drives.permit.enabled
