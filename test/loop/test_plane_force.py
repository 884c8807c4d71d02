# SPDX-License-Identifier: Apache-2.0
"""The plane judges the force samples that it takes: status, numbers, size and age."""

from __future__ import annotations

import math

import pytest

from screw_module_ros.loop.plane import Plane
from screw_module_ros.loop.plane_controller import JointSettings, PlaneLimits
from screw_module_ros.samples import ForceReading
from screw_module_ros.trials.one_thread import PERIOD_NS

MS = 1_000_000


def sent(bench, age_ms=0, **changed) -> None:
    """Have a force sample arrive at the plane, in place of the sensor's own."""
    stamp_ns = bench.now_ns - age_ms * MS
    reading = ForceReading(stamp_ns // MS, stamp_ns, 0, *[0.0] * 6, 0)
    bench.plane.controller.on_force(reading._replace(**changed), bench.now_ns)


def alive(bench, count=20) -> None:
    for _ in range(count):
        bench.tick()
        sent(bench)


@pytest.fixture
def moving(bench, plane):
    """A plane with torque, whose force samples the test sends."""
    bench.plane_hears_force = False
    alive(bench)
    assert plane.drives.permit.enabled
    return bench


@pytest.fixture(params=[PlaneLimits()])
def without(bench, request):
    """A plane with these limits that has just begun, and hears of no force."""
    old = bench.plane
    bench.plane_hears_force = False
    bench.plane = Plane(
        bench.planar_drives, bench.ports["planar"], PERIOD_NS, old.controller.settings,
        JointSettings(), old.drives.permit.settings, limits=request.param,
    )  # fmt: skip
    bench.ticks(30)
    assert bench.plane.take_home(bench.now_ns) == ""
    return bench


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"status": 1 << 4}, "supply too high (status bit 4)"),
        ({"fx": math.nan}, "not a finite number"),
        ({"tz": math.inf}, "not a finite number"),
        ({"fx": -90.01, "fy": 120.0}, "150 N on the handle, more than 150 N"),
    ],
)
def test_a_sample_that_cannot_be_used_stops_the_plane(moving, changed, said):
    moving.tick()
    sent(moving, **changed)
    moving.tick()
    assert said in moving.plane.drives.permit.reason
    assert moving.plane.drives.written == (0.0, 0.0)
    alive(moving)
    assert said in moving.plane.drives.permit.reason, "it stays until clear_fault"


def test_what_presses_on_the_screw_alone_is_the_controllers_concern(moving):
    sent(moving, fx=-90.0, fy=120.0, fz=400.0)  # 150 N in the plane
    moving.tick()
    assert moving.plane.drives.permit.enabled


def test_a_silent_sensor_stops_the_plane_that_had_one(moving):
    """The guard of 150 N used to end after 0.2 s without a word."""
    moving.ticks(4)
    assert moving.plane.drives.permit.enabled
    moving.ticks(4)
    assert "force sensor: no sample for" in moving.plane.drives.permit.reason


@pytest.mark.parametrize("without", [PlaneLimits(force_required=False)], indirect=True)
def test_a_plane_without_a_force_sensor_says_so_in_its_settings(without):
    assert without.enable_plane() == ""
    without.ticks(100)
    assert without.plane.drives.permit.enabled


def test_without_a_force_sample_the_plane_is_not_enabled(without):
    """Neither its limit of 150 N nor the check for a frozen position would act."""
    assert without.enable_plane() == "force sensor: no sample yet"
    sent(without)
    assert without.enable_plane() == ""
