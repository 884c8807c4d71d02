# SPDX-License-Identifier: Apache-2.0
"""The planar law: an isotropic spring at the handle, within its limits under anything at all."""

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from law_runs import PLANE_DT as DT
from law_runs import handle_force, initial_plane, planar_outputs, planar_step, plane_at

from screw_module_ros.control.arms import FIVE_BAR, reaches
from screw_module_ros.control.planar import PlanarInput
from screw_module_ros.control.planar_settings import PlanarSettings
from screw_module_ros.geometry import MANUS, PlanarArm, forward, inverse, jacobian

SETTINGS = PlanarSettings().validated()
PULLED = plane_at(0.1, 0.0, (0.0, 0.0, 0.0, 0.0))
"""The handle 10 cm beside its set point."""


def settled(inp, ticks=1500, law=SETTINGS):
    """Output after an input has stood still for some time."""
    return planar_outputs([inp] * ticks, law)[-1]


def full(law=SETTINGS):
    """State of a law that has faded in."""
    state = initial_plane(law)
    state.weight, state.stiffness, state.damping = 1.0, law.stiffness, law.damping
    return state


def torques(output):
    return output.shoulder_torque, output.elbow_torque


@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (0.1, -0.1), (-0.12, 0.15)])
@pytest.mark.parametrize(("dx", "dy"), [(0.05, 0.0), (0.0, 0.05), (-0.03, 0.04)])
def test_the_spring_is_the_same_in_all_directions(x, y, dx, dy):
    inp = plane_at(x, y, (x + dx, y + dy, 0.0, 0.0))
    output = settled(inp)
    assert handle_force(output, inp) == pytest.approx((100 * dx, 100 * dy), abs=1e-6)
    assert not output.saturated


def test_the_damper_acts_against_the_velocity():
    inp = plane_at(0.0, 0.0, (0.0, 0.0, 0.0, 0.0), velocity=(0.2, -0.1))
    output = settled(inp)
    assert (output.vx, output.vy) == pytest.approx((0.2, -0.1))
    assert handle_force(output, inp) == pytest.approx((-2.0, 1.0))


@pytest.mark.parametrize(
    ("aim_x", "desired"), [(math.nan, (0.05, 0.08)), (-0.05, (-0.05, 0.08))]
)
def test_an_axis_without_a_set_point_is_left_where_it_was_measured(aim_x, desired):
    output = settled(plane_at(0.05, 0.08, (aim_x, math.nan, 0.0, 0.0)))
    assert (output.desired_x, output.desired_y) == pytest.approx(desired)
    free = settled(plane_at(0.05, 0.08))
    assert torques(free) == pytest.approx((0.0, 0.0))


def test_force_limit_keeps_the_direction():
    inp = plane_at(0.0, 0.0, (0.12, 0.16, 0.0, 0.0))
    output = settled(inp, 3000, SETTINGS._replace(stiffness=2000.0))
    assert output.saturated
    assert (output.force_x, output.force_y) == pytest.approx((27.0, 36.0))


@pytest.mark.parametrize(("x", "y"), [(0.20, 0.0), (-0.20, 0.0), (0.0, 0.24), (0.0, -0.24)])
def test_outside_the_workspace_the_force_points_inward(x, y):
    output = settled(plane_at(x, y, (2 * x, 2 * y, 0.0, 0.0)))
    assert output.force_x * x <= 0.0 and output.force_y * y <= 0.0
    assert math.hypot(output.force_x, output.force_y) >= 1000 * 0.015


@pytest.mark.parametrize(
    ("shoulder", "elbow"), [(0.7, 0.71), (0.7, 0.7), (0.7, 0.7 + math.pi), (-1.5, 1.5), (3.0, 3.3)]
)
def test_stretched_folded_and_turned_away_the_law_stays_finite_and_pushes_back(shoulder, elbow):
    output = settled(PlanarInput(shoulder, elbow, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, True))
    assert all(math.isfinite(value) for value in output)
    assert torques(output) != (0.0, 0.0)


@given(
    st.floats(0.12, 0.92), st.floats(-1.5, 1.5), st.floats(-0.2, 0.2), st.floats(-0.25, 0.25)
)
def test_no_stop_presses_harder_on_the_hand_than_the_limit(reach, way, aim_x, aim_y):
    """Also a joint's stop near a stretched arm, 1 cm behind the corners near the patient."""
    inp = plane_at(reach * math.sin(way), 0.60 - reach * math.cos(way), (aim_x, aim_y, 0.0, 0.0))
    assume(0.02 < inp.shoulder - inp.elbow < math.pi - 0.02)
    state = initial_plane(SETTINGS)
    state.weight = 1.0
    output = planar_outputs([inp] * 60, SETTINGS, state)[-1]
    assert math.hypot(*handle_force(output, inp)) <= SETTINGS.force_limit * (1.0 + 1e-9)


@given(
    st.floats(-0.17, 0.17), st.floats(-0.2, 0.2), st.floats(0.0, 2.0 * math.pi),
    st.sampled_from([(2000.0, 0.0), (500.0, 0.6)]),
)
def test_on_the_way_from_one_force_to_another_the_limit_holds_too(x, y, way, pulled):
    """A stiff spring whose set point changes sides, a stiff damper whose motion does."""
    stiffness, speed = pulled
    law = SETTINGS._replace(stiffness=stiffness, damping=100.0)
    state, cosine, sine = full(law), math.cos(way), math.sin(way)
    for side in (1.0, -1.0, 1.0, -1.0):
        aim = (x + 0.3 * side * cosine, y + 0.3 * side * sine, 0.0, 0.0)
        inp = plane_at(x, y, aim, velocity=(side * speed * cosine, side * speed * sine))
        for output in planar_outputs([inp] * 100, law, state):
            assert math.hypot(*handle_force(output, inp)) <= law.force_limit * (1.0 + 1e-9)


def test_the_joints_stops_still_push_a_stretched_arm_back():
    inp = plane_at(0.19, -0.30)
    output = settled(inp)
    fx, fy = handle_force(output, inp)
    assert math.hypot(fx, fy) == pytest.approx(SETTINGS.force_limit)
    assert fx < 0.0 < fy
    assert output.saturated


def test_inactive_is_zero_at_once_and_enabling_begins_anew():
    inputs = [PULLED] * 1500 + [PULLED._replace(active=False), PULLED]
    *_, pulled, inactive, enabled = map(torques, planar_outputs(inputs))
    assert pulled[0] != 0.0 and inactive == (0.0, 0.0)
    assert sum(map(abs, enabled)) < 0.05


@pytest.mark.parametrize("field", PlanarInput._fields[:4])
@pytest.mark.parametrize("value", [math.nan, math.inf, -1e300])
def test_a_measurement_that_cannot_be_gives_zero(field, value):
    output = planar_outputs([PULLED] * 300 + [PULLED._replace(**{field: value})])[-1]
    assert torques(output) == (0.0, 0.0)
    assert (output.vx, output.vy) == (0.0, 0.0), "nothing is known of the motion"
    assert all(math.isfinite(value) for value in output)


@pytest.mark.parametrize("ix", range(-10, 11))
def test_workspace_lies_within_the_joint_limits(ix):
    for iy in range(-10, 11):
        x = ix / 10 * (SETTINGS.half_width - SETTINGS.box_zone)
        y = iy / 10 * (SETTINGS.half_depth - SETTINGS.box_zone)
        assert torques(settled(plane_at(x, y), 1)) == pytest.approx((0.0, 0.0), abs=1e-9)
        assert forward(*inverse(x, y)) == pytest.approx((x, y))


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"stiffness": math.nan}, "stiffness"),
        ({"force_limit": -1.0}, "force_limit"),
        ({"elbow_high": -3.0}, "elbow_high"),
        ({"between_high": 0.1}, "between_high"),
        ({"elbow_low": 1.35}, "elbow_low"),
        ({"half_width": 0.02, "box_zone": 0.02}, "half_width"),
    ],
)
def test_settings_out_of_range_are_refused_by_name(change, named):
    with pytest.raises(ValueError, match=named):
        SETTINGS._replace(**change).validated()


def test_the_links_are_those_of_the_settings():
    """Another arm: the same force at the hand needs the torques of its own Jacobian."""
    arm = PlanarArm(upper_arm=0.3, forearm=0.35, base_y=0.45)
    law = SETTINGS._replace(arm=arm, shoulder_low=-3.0, shoulder_high=3.0, elbow_low=-6.0,
                            elbow_high=3.0, between_low=-3.0)  # fmt: skip
    angles = inverse(0.05, -0.02, arm)
    output = settled(PlanarInput(*angles, 0.0, 0.0, 0.1, -0.02, 0.0, 0.0, True), 2000, law)
    assert (output.x, output.y) == pytest.approx((0.05, -0.02))
    x_s, x_e, y_s, y_e = jacobian(*angles, arm)
    fx, fy = output.force_x, output.force_y
    assert torques(output) == pytest.approx((x_s * fx + y_s * fy, x_e * fx + y_e * fy))
    assert fx == pytest.approx(law.stiffness * 0.05, rel=1e-3)


def test_what_an_arm_reaches():
    assert reaches(FIVE_BAR, 0.0, 0.0, MANUS)
    assert reaches(FIVE_BAR, 0.0, 0.3, MANUS)
    assert not reaches(FIVE_BAR, 0.0, -0.33, MANUS), "stretched towards the patient"
    assert not reaches(FIVE_BAR, 0.0, 0.0, PlanarArm(upper_arm=0.2, forearm=0.2))


def test_towards_an_edge_the_speed_limit_falls_with_the_way_left():
    law = SETTINGS._replace(stiffness=0.0, damping=0.0)
    allowed = math.sqrt(2.0 * law.edge_braking * 0.1)
    for speed, braked in (
        (0.95 * allowed, 0.0),
        (allowed + 0.1, -0.1 * law.speed_damping),
        (2.0 * allowed, -law.force_limit),
        (-0.95 * law.speed_limit, 0.0),  # the way back
    ):
        inp = plane_at(0.0, law.half_depth - 0.1, velocity=(0.0, speed))
        output = planar_step(law, full(law), inp, DT)
        assert output.force_y == pytest.approx(braked, rel=1e-6, abs=1e-9), speed
