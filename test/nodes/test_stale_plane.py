# SPDX-License-Identifier: Apache-2.0
"""A planar drive that does not answer has no position: none is shown as the handle's."""

from __future__ import annotations

import math

import pytest
from screw_module_msgs.msg import EndpointState, PlanarState

from screw_module_ros.nodes.endpoint_state import _fill_plane, planar_joints
from screw_module_ros.nodes.support.states import fill_plane
from screw_module_ros.trials.one_thread import Bench


@pytest.fixture
def bench():
    made = Bench()
    made.ready()
    yield made
    made.close()


def shown(bench, plane: PlanarState) -> EndpointState:
    """Return what `endpoint_state` makes of the plane's state now."""
    fill_plane(plane, bench.plane, bench.now_ns)
    message = EndpointState()
    _fill_plane(message, plane)
    return message


def test_the_plane_is_invalid_while_a_drive_is_silent(bench):
    plane = PlanarState()
    before = shown(bench, plane)
    assert list(before.valid[:2]) == [True, True]
    assert planar_joints(plane).keys() == {"shoulder", "elbow"}
    bench.rig.inject("elbow", "cable_out", 0.0, 0.0, bench.now_ns)
    bench.ticks(150)
    assert bench.plane.homed, "the count is not lost yet"
    message = shown(bench, plane)
    assert list(message.valid[:2]) == [False, False]
    assert math.isnan(message.position.x) and math.isnan(message.velocity.y)
    assert planar_joints(plane) == {}
    bench.rig.inject("elbow", "clear", 0.0, 0.0, bench.now_ns)
    assert bench._asking(bench.plane.clear_fault) == ""
    bench.ticks(20)
    message = shown(bench, plane)
    assert list(message.valid[:2]) == [True, True]
    assert message.position.x == pytest.approx(before.position.x, abs=1e-3)


def test_a_lost_answer_does_not_make_it_invalid(bench):
    plane = PlanarState()
    before = shown(bench, plane)
    bench.rig.inject("elbow", "cable_out", 0.0, 0.0, bench.now_ns)
    bench.ticks(3)
    assert bench.plane.output is None
    assert shown(bench, plane).position.x == before.position.x
