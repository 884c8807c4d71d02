# SPDX-License-Identifier: Apache-2.0
"""What the nodes show: every field of a state, samples as they are judged, the plane, the pin."""

from __future__ import annotations

import math

import pytest
from screw_module_msgs.msg import (
    AmplifierState,
    EndpointState,
    ImpedanceState,
    PlanarState,
    SafetyState,
)
from wired import Topics

from screw_module_ros.clock import ManualClock
from screw_module_ros.control.planar_settings import least_damping
from screw_module_ros.geometry import forward
from screw_module_ros.nodes.amplifier import fill_amplifier
from screw_module_ros.nodes.endpoint_state import (
    _fill_force,
    _fill_plane,
    _fill_vertical,
    carried,
    planar_joints,
)
from screw_module_ros.nodes.impedance_controller import fill_controller
from screw_module_ros.nodes.manus import fill_plane
from screw_module_ros.plant.world import ArmSettings
from screw_module_ros.safety.checks import VerticalChecks, WatchSettings
from screw_module_ros.samples import EncoderReading, ForceReading


class Noted:
    """Stands for a message; `missing` are the fields that nobody has written."""

    def __init__(self, kind: type):
        vars(self)["missing"] = set(kind.get_fields_and_field_types())

    def __setattr__(self, name: str, value: object) -> None:
        self.missing.remove(name)


@pytest.mark.parametrize(
    ("kind", "fill", "part", "by_the_node"),
    [
        (ImpedanceState, fill_controller, "controller", {"header", "calibration", "law"}),
        (AmplifierState, fill_amplifier, "axis", {"header", "calibration"}),
        (PlanarState, fill_plane, "plane",
         {"header", "sequence", "monotonic_ns", "law", "arm"}),
    ],
)
def test_every_field_of_a_state_is_written_once(bench, kind, fill, part, by_the_node):
    message = Noted(kind)
    fill(message, getattr(bench, part), bench.now_ns)
    assert message.missing == by_the_node


def shown_plane(bench, plane: PlanarState) -> EndpointState:
    """Return what `endpoint_state` makes of the plane's state now."""
    fill_plane(plane, bench.plane, bench.now_ns)
    message = EndpointState(monotonic_ns=plane.monotonic_ns)
    _fill_plane(message, carried(plane, message.monotonic_ns))
    return message


def test_of_an_arm_that_the_urdf_does_not_describe_there_are_no_joints(bench):
    """Who shows the URDF would take its angles for those of MIT-MANUS; where the hand is stays."""
    plane = PlanarState()
    before = shown_plane(bench, plane)
    plane.arm = "five_bar 0123456789ab"
    assert planar_joints(carried(plane, bench.now_ns)).keys() == {"shoulder", "elbow"}
    plane.arm = "serial 0123456789ab"
    assert planar_joints(carried(plane, bench.now_ns)) == {}
    message = EndpointState(monotonic_ns=plane.monotonic_ns)
    _fill_plane(message, carried(plane, message.monotonic_ns))
    assert message.valid[0] and message.position.x == before.position.x


def test_the_plane_is_invalid_while_a_drive_is_silent(bench):
    plane = PlanarState()
    before = shown_plane(bench, plane)
    assert list(before.valid[:2]) == [True, True]
    assert planar_joints(carried(plane, bench.now_ns)).keys() == {"shoulder", "elbow"}
    bench.rig.inject("elbow", "cable_out", 0.0, 0.0, bench.now_ns)
    bench.ticks(150)
    assert bench.plane.controller.homed, "the count is not lost yet"
    message = shown_plane(bench, plane)
    assert list(message.valid[:2]) == [False, False]
    assert math.isnan(message.position.x) and math.isnan(message.velocity.y)
    assert planar_joints(carried(plane, bench.now_ns)) == {}
    bench.rig.inject("elbow", "clear", 0.0, 0.0, bench.now_ns)
    assert bench.clear_plane_fault() == ""
    bench.ticks(20)
    message = shown_plane(bench, plane)
    assert list(message.valid[:2]) == [True, True]
    assert message.position.x == pytest.approx(before.position.x, abs=1e-3)


def test_a_lost_answer_does_not_make_it_invalid(bench):
    plane = PlanarState()
    before = shown_plane(bench, plane)
    bench.rig.inject("elbow", "cable_out", 0.0, 0.0, bench.now_ns)
    bench.ticks(3)
    assert bench.plane.controller.output is None
    assert shown_plane(bench, plane).position.x == before.position.x


def test_x_and_y_are_of_the_instant_of_z(bench):
    """Uncarried they lag by 3 to 4 ms, 2 mm on a fast hand."""
    bench.world.set_arm(
        ArmSettings(kind="active", stiffness=3000.0, damping=100.0, amplitude=(0.1, 0.08, 0.0),
                    omega=(5.0, 4.0, 0.0))
    )  # fmt: skip
    bench.seconds(1.0)
    before, after = PlanarState(), PlanarState()
    lagging, left = [], []
    for _ in range(200):
        fill_plane(before, bench.plane, bench.now_ns)
        bench.ticks(4)
        fill_plane(after, bench.plane, bench.now_ns)
        now = carried(before, before.monotonic_ns + 4_000_000)
        there = tuple(after.position)
        lagging.append(math.dist(tuple(before.position), there))
        left.append(math.dist(now.position, there))
    assert max(lagging) > 0.8e-3
    assert max(left) < 0.2 * max(lagging)


def test_joints_and_endpoint_of_one_stamp_show_one_pose(bench):
    """Angles that stayed behind while x and y were carried were 1.2 mm off at 0.2 m/s."""
    bench.world.set_arm(
        ArmSettings(kind="active", stiffness=3000.0, damping=100.0, amplitude=(0.1, 0.08, 0.0),
                    omega=(5.0, 4.0, 0.0))
    )  # fmt: skip
    bench.seconds(1.0)
    plane, message = PlanarState(), EndpointState()
    apart, fastest = [], 0.0
    for _ in range(200):
        bench.ticks(4)
        fill_plane(plane, bench.plane, bench.now_ns)
        now = carried(plane, plane.monotonic_ns + 8_000_000)  # the oldest that a state becomes
        _fill_plane(message, now)
        joints = planar_joints(now)
        upper, between = joints["shoulder"][0], joints["elbow"][0]
        shown = message.position.x, message.position.y
        apart.append(math.dist(forward(upper, upper + between), shown))
        fastest = max(fastest, math.hypot(*now.velocity))
    assert fastest > 0.2
    assert max(apart) < 0.05e-3


def test_a_velocity_is_good_for_20_ms_alone(bench):
    plane, message = PlanarState(), EndpointState()
    fill_plane(plane, bench.plane, bench.now_ns)
    plane.velocity = [1.0, -1.0]
    message.monotonic_ns = plane.monotonic_ns + 90_000_000
    _fill_plane(message, carried(plane, message.monotonic_ns))
    assert message.position.x == pytest.approx(plane.position[0] + 0.02)
    assert message.position.y == pytest.approx(plane.position[1] - 0.02)


def test_the_damping_shown_is_the_one_in_use(bench):
    """A force gain needs more than the setting, else a released handle swings."""
    plane = PlanarState()
    fill_plane(plane, bench.plane, bench.now_ns)
    controller = bench.plane.controller
    assert plane.damping == controller.settings.damping
    controller.settings = controller.settings._replace(damping=2.0, force_gain=9.0)
    assert bench.enable_plane() == ""
    bench.seconds(3.0)
    fill_plane(plane, bench.plane, bench.now_ns)
    settings = controller.settings
    assert plane.damping == pytest.approx(least_damping(settings, settings.stiffness, 9.0))
    assert plane.damping > settings.damping


PERIOD_NS = 1_000_000
FORCE = ForceReading(1, PERIOD_NS, PERIOD_NS, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 0)
ENCODER = EncoderReading(1, PERIOD_NS, PERIOD_NS, 0, 0.1, 0.0, True)


@pytest.mark.parametrize("change", [
    *({"status": 1 << bit} for bit in range(16)), {"fx": math.nan}, {"tz": math.inf}, {},
])  # fmt: skip
def test_a_force_sample(change):
    sample, message = FORCE._replace(**change), EndpointState()
    checks = VerticalChecks(WatchSettings(), PERIOD_NS)
    used = checks.force(sample, PERIOD_NS) and not checks.fault.reason
    _fill_force(message, sample)
    assert message.force_valid == used
    assert math.isfinite(message.force.z) == used


@pytest.mark.parametrize("change", [{"position": math.nan}, {"velocity": math.inf}, {}])
def test_an_encoder_sample(change):
    sample, message = ENCODER._replace(**change), EndpointState()
    used = VerticalChecks(WatchSettings(), PERIOD_NS).encoder(sample, PERIOD_NS)
    _fill_vertical(message, sample)
    assert message.valid[2] == used
    assert math.isfinite(message.position.z) == math.isfinite(message.velocity.z) == used


@pytest.fixture
def shown_pin(make_node):
    """Return a function that returns safety and pin as shown at a time [ns]."""
    node = make_node("endpoint_state")
    ends = Topics(node)
    clock = node.clock = ManualClock()
    node.trigger_configure()
    node.trigger_activate()

    def shown_at(now_ns: int) -> tuple[int, bool]:
        clock.time_ns = now_ns
        node.step()
        shown = ends.told["endpoint_state"][-1]
        return shown.safety, shown.vertical_locked

    shown_at.heard = ends.heard["safety_state"]
    return shown_at


def test_a_pin_does_not_come_out_with_the_supervisor_s_end(shown_pin):
    assert shown_pin(10**9) == (SafetyState.UNKNOWN, False)
    shown_pin.heard.append(SafetyState(level=SafetyState.OK, vertical_locked=True))
    assert shown_pin(2 * 10**9) == (SafetyState.OK, True)
    assert shown_pin(9 * 10**9) == (SafetyState.UNKNOWN, True)
