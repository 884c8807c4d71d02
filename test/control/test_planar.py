# SPDX-License-Identifier: Apache-2.0
"""The planar law: an isotropic spring at the handle, within its limits under anything at all."""

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from screw_module_ros.control.planar import PlanarInput, initial_state, planar_step
from screw_module_ros.control.planar_settings import PlanarSettings
from screw_module_ros.geometry import PlanarArm, forward, inverse, jacobian, reaches

SETTINGS = PlanarSettings().validated()
DT = 0.002
NO_SETPOINT = (math.nan,) * 4


def at(x, y, setpoint=NO_SETPOINT, velocity=(0.0, 0.0), active=True):
    """Input with the handle at x, y [m], moving with a velocity [m/s]."""
    shoulder, elbow = inverse(x, y)
    x_s, x_e, y_s, y_e = jacobian(shoulder, elbow)
    determinant = x_s * y_e - x_e * y_s
    vx, vy = velocity
    return PlanarInput(
        shoulder,
        elbow,
        (y_e * vx - x_e * vy) / determinant,
        (x_s * vy - y_s * vx) / determinant,
        *setpoint,
        active,
    )


def run(inp, seconds=3.0, law=SETTINGS, state=None):
    """Output and state after an input has stood still for some time."""
    state, output = state or initial_state(law), None
    for _ in range(round(seconds / DT)):
        output = planar_step(law, state, inp, DT)
    return output, state


def handle_force(output, inp):
    """Force at the handle [N] the torques make: the Jacobian transpose, inverted."""
    x_s, x_e, y_s, y_e = jacobian(inp.shoulder, inp.elbow)
    determinant = x_s * y_e - x_e * y_s
    return (
        (y_e * output.shoulder_torque - y_s * output.elbow_torque) / determinant,
        (x_s * output.elbow_torque - x_e * output.shoulder_torque) / determinant,
    )


@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (0.1, -0.1), (-0.12, 0.15)])
def test_the_spring_is_the_same_in_all_directions(x, y):
    for dx, dy in [(0.05, 0.0), (0.0, 0.05), (-0.03, 0.04)]:
        inp = at(x, y, (x + dx, y + dy, 0.0, 0.0))
        output, _ = run(inp)
        assert handle_force(output, inp) == pytest.approx((100 * dx, 100 * dy), abs=1e-6)
        assert not output.saturated


def test_the_damper_acts_against_the_velocity():
    inp = at(0.0, 0.0, (0.0, 0.0, 0.0, 0.0), velocity=(0.2, -0.1))
    output, _ = run(inp)
    assert (output.vx, output.vy) == pytest.approx((0.2, -0.1))
    assert handle_force(output, inp) == pytest.approx((-2.0, 1.0))


def test_the_spring_starts_at_the_measured_position():
    inp = at(0.05, 0.08)
    output, _ = run(inp)
    assert (output.desired_x, output.desired_y) == pytest.approx((0.05, 0.08))
    assert (output.shoulder_torque, output.elbow_torque) == pytest.approx((0.0, 0.0))


def test_an_axis_without_a_set_point_is_left_alone():
    output, _ = run(at(0.05, 0.08, (-0.05, math.nan, 0.0, 0.0)))
    assert (output.desired_x, output.desired_y) == pytest.approx((-0.05, 0.08))


def test_force_limit_keeps_the_direction():
    law = SETTINGS._replace(stiffness=2000.0)
    inp = at(0.0, 0.0, (0.12, 0.16, 0.0, 0.0))
    output, _ = run(inp, 6.0, law)
    assert output.saturated
    assert (output.force_x, output.force_y) == pytest.approx((27.0, 36.0))


def test_outside_the_workspace_the_force_points_inward():
    for x, y in [(0.20, 0.0), (-0.20, 0.0), (0.0, 0.24), (0.0, -0.24)]:
        output, _ = run(at(x, y, (2 * x, 2 * y, 0.0, 0.0)))
        assert output.force_x * x <= 0.0
        assert output.force_y * y <= 0.0
        assert math.hypot(output.force_x, output.force_y) >= 1000 * 0.015


@pytest.mark.parametrize(
    ("shoulder", "elbow"), [(0.7, 0.71), (0.7, 0.7), (0.7, 0.7 + math.pi), (-1.5, 1.5), (3.0, 3.3)]
)
def test_stretched_folded_and_turned_away_the_law_stays_finite_and_pushes_back(shoulder, elbow):
    inp = PlanarInput(shoulder, elbow, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, True)
    output, _ = run(inp)
    assert all(math.isfinite(value) for value in output)
    assert (output.shoulder_torque, output.elbow_torque) != (0.0, 0.0)


@given(
    st.floats(0.12, 0.92), st.floats(-1.5, 1.5), st.floats(-0.2, 0.2), st.floats(-0.25, 0.25)
)
def test_no_stop_presses_harder_on_the_hand_than_the_limit(reach, way, aim_x, aim_y):
    """Also a joint's stop near a stretched arm, 1 cm behind the far corners of the workspace."""
    inp = at(reach * math.sin(way), reach * math.cos(way) - 0.65, (aim_x, aim_y, 0.0, 0.0))
    assume(0.02 < inp.elbow - inp.shoulder < math.pi - 0.02)
    state = initial_state(SETTINGS)
    state.weight = 1.0
    for _ in range(60):
        output = planar_step(SETTINGS, state, inp, DT)
    assert math.hypot(*handle_force(output, inp)) <= SETTINGS.force_limit * (1.0 + 1e-9)


@given(
    st.floats(-0.17, 0.17), st.floats(-0.2, 0.2), st.floats(0.0, 2.0 * math.pi),
    st.sampled_from([(2000.0, 0.0), (500.0, 0.6)]),
)
def test_on_the_way_from_one_force_to_another_the_limit_holds_too(x, y, way, pulled):
    """A stiff spring whose set point changes sides, a stiff damper whose motion does."""
    stiffness, speed = pulled
    law = SETTINGS._replace(stiffness=stiffness, damping=100.0)
    state = initial_state(law)
    state.weight, state.stiffness, state.damping = 1.0, stiffness, 100.0
    cosine, sine = math.cos(way), math.sin(way)
    for k in range(400):
        side = 1.0 if k // 100 % 2 == 0 else -1.0
        aim = (x + 0.3 * side * cosine, y + 0.3 * side * sine, 0.0, 0.0)
        inp = at(x, y, aim, velocity=(side * speed * cosine, side * speed * sine))
        output = planar_step(law, state, inp, DT)
        assert math.hypot(*handle_force(output, inp)) <= law.force_limit * (1.0 + 1e-9)


def test_the_joints_stops_still_push_a_stretched_arm_back():
    inp = at(0.19, 0.24)
    output, _ = run(inp)
    fx, fy = handle_force(output, inp)
    assert math.hypot(fx, fy) == pytest.approx(SETTINGS.force_limit)
    assert fx < 0.0 and fy < 0.0
    assert output.saturated


def test_inactive_is_zero_at_once_and_enabling_begins_anew():
    inp = at(0.1, 0.0, (0.0, 0.0, 0.0, 0.0))
    output, state = run(inp)
    assert output.shoulder_torque != 0.0
    output = planar_step(SETTINGS, state, inp._replace(active=False), DT)
    assert (output.shoulder_torque, output.elbow_torque) == (0.0, 0.0)
    output = planar_step(SETTINGS, state, inp, DT)
    assert abs(output.shoulder_torque) + abs(output.elbow_torque) < 0.05


@pytest.mark.parametrize("field", PlanarInput._fields[:4])
@pytest.mark.parametrize("value", [math.nan, math.inf, -1e300])
def test_a_measurement_that_cannot_be_gives_zero(field, value):
    inp = at(0.1, 0.0, (0.0, 0.0, 0.0, 0.0))
    _, state = run(inp)
    output = planar_step(SETTINGS, state, inp._replace(**{field: value}), DT)
    assert (output.shoulder_torque, output.elbow_torque) == (0.0, 0.0)
    assert (output.vx, output.vy) == (0.0, 0.0), "nothing is known of the motion"
    assert all(math.isfinite(value) for value in output)


def test_workspace_lies_within_the_joint_limits():
    for ix in range(-10, 11):
        for iy in range(-10, 11):
            x = ix / 10 * (SETTINGS.half_width - SETTINGS.box_zone)
            y = iy / 10 * (SETTINGS.half_depth - SETTINGS.box_zone)
            output = planar_step(SETTINGS, initial_state(SETTINGS), at(x, y), DT)
            torques = output.shoulder_torque, output.elbow_torque
            assert torques == pytest.approx((0.0, 0.0), abs=1e-9)
            assert forward(*inverse(x, y)) == pytest.approx((x, y))


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"stiffness": math.nan}, "stiffness"),
        ({"force_limit": -1.0}, "force_limit"),
        ({"elbow_high": 1.4}, "elbow_high"),
        ({"half_width": 0.02, "box_zone": 0.02}, "half_width"),
    ],
)
def test_settings_out_of_range_are_refused_by_name(change, named):
    with pytest.raises(ValueError, match=named):
        SETTINGS._replace(**change).validated()


def test_the_links_are_those_of_the_settings():
    """Another arm: the same force at the hand needs the torques of its own Jacobian."""
    arm = PlanarArm(upper_arm=0.3, forearm=0.35, base_y=-0.45)
    law = SETTINGS._replace(arm=arm, shoulder_low=-3.0, shoulder_high=3.0, elbow_low=-3.0,
                            elbow_high=6.0, between_high=3.0)  # fmt: skip
    shoulder, elbow = inverse(0.05, -0.02, arm)
    state = initial_state(law)
    inp = PlanarInput(shoulder, elbow, 0.0, 0.0, 0.1, -0.02, 0.0, 0.0, True)
    for _ in range(2000):
        output = planar_step(law, state, inp, DT)
    assert (output.x, output.y) == pytest.approx((0.05, -0.02))
    x_s, x_e, y_s, y_e = jacobian(shoulder, elbow, arm)
    assert output.shoulder_torque == pytest.approx(x_s * output.force_x + y_s * output.force_y)
    assert output.elbow_torque == pytest.approx(x_e * output.force_x + y_e * output.force_y)
    assert output.force_x == pytest.approx(law.stiffness * 0.05, rel=1e-3)


def test_what_an_arm_reaches():
    assert reaches(0.0, 0.0)
    assert not reaches(0.0, 0.3)
    assert not reaches(0.0, 0.0, PlanarArm(upper_arm=0.2, forearm=0.2))
