# SPDX-License-Identifier: Apache-2.0
"""The planar arm: inertia with the module, energy, J^T F, friction, stops."""

from __future__ import annotations

import functools
import math

import numpy
import pytest
from hypothesis import example, given
from hypothesis import settings as run_settings
from hypothesis import strategies as st

from screw_module_ros.compiled import compiled, packed
from screw_module_ros.plant.friction import bristle_terms, settled_bristle
from screw_module_ros.plant.patient import ArmForce, arm_force
from screw_module_ros.plant.planar import (
    ManusInput,
    ManusState,
    handle_place,
    planar_params,
    planar_step,
    resting_plane,
    tip,
)

pytestmark = pytest.mark.long

L1, L2 = 0.4064, 0.51435
IDLE_AT = ManusState(*(0.0,) * len(ManusState._fields))
IDLE = ManusInput(0.0, 0.0, True, True, False, False, False, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def step_packed(p, s, u):
    return planar_step(p[0], s, u)


def quick_step(p, s, u):
    return compiled(step_packed)(packed_once(p), s, u)


packed_once = functools.cache(packed)


@pytest.fixture(scope="session")
def plane(settings):
    """The default planar arm with the default patient."""
    return planar_params(settings.planar, arm_force(settings.arm), settings.substep)


@pytest.fixture(scope="session")
def slippery(settings):
    """The same with next to no friction and an instant torque loop."""
    robot = settings.planar._replace(
        friction=0.001, viscous=0.0, bristle_damping=0.0, bandwidth=1e5
    )
    return planar_params(robot, arm_force(settings.arm), settings.substep)


def inertia(shoulder, elbow, mass):
    """M(q) of params/plant.yaml with a mass at the tip, written out again."""
    coupling = (0.171 + mass * L1 * L2) * math.cos(elbow - shoulder)
    return 0.173 + mass * L1 * L1, coupling, 0.226 + mass * L2 * L2


def kinetic(s, mass):
    """Of the arm, and of the module beyond the structure."""
    m11, m12, m22 = inertia(s.shoulder, s.elbow, 0.0)
    w1, w2 = s.shoulder_velocity, s.elbow_velocity
    arm = 0.5 * (m11 * w1 * w1 + 2.0 * m12 * w1 * w2 + m22 * w2 * w2)
    return arm + 0.5 * mass * (s.handle_vx**2 + s.handle_vy**2)


def bent(s, robot):
    """Return the energy in the structure's spring [J]."""
    return 0.5 * robot.structure_stiffness * (s.bend_x**2 + s.bend_y**2)


def bristles(s, robot):
    """Return the energy that the friction's bristles can give back [J]."""
    return (s.shoulder_bristle**2 + s.elbow_bristle**2) / (2.0 * robot.bristle_stiffness)


def jacobian(s):
    return numpy.array([
        [-L1 * math.sin(s.shoulder), -L2 * math.sin(s.elbow)],
        [L1 * math.cos(s.shoulder), L2 * math.cos(s.elbow)],
    ])  # fmt: skip


def turning(s, w1, w2):
    """Return the arm with joints and module in the same motion [rad/s]."""
    vx, vy = jacobian(s) @ (w1, w2)
    return s._replace(shoulder_velocity=w1, elbow_velocity=w2, handle_vx=vx, handle_vy=vy)


def run(p, s, u, steps):
    for _ in range(steps):
        s = quick_step(p, s, u)
    return s


@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (0.15, 0.2), (-0.19, -0.22), (0.19, -0.1)])
@pytest.mark.parametrize("base_y", [0.60, -0.60])
@pytest.mark.parametrize("side", ["right", "left"])
def test_start_reaches_the_point_with_the_elbow_on_its_side(settings, base_y, side, x, y):
    robot = settings.planar._replace(elbow=side, base_y=base_y)
    s = resting_plane(robot, x, y)
    assert tip(robot, s.shoulder, s.elbow) == pytest.approx((x, y), abs=1e-12)
    elbow_x, elbow_y = (L1 * wave(s.shoulder) for wave in (math.cos, math.sin))
    line = x * elbow_y / (y - base_y)  # of the line from the base to the handle, beside the elbow
    assert elbow_x > line if side == "right" else elbow_x < line


@pytest.mark.parametrize(
    ("name", "anisotropy", "heaviest"),
    [("appendix_d", (1.23, 1.54), 1.31), ("inmotion2", (2.75, 4.05), 3.41)],
)
def test_each_set_of_inertias_has_the_figures_that_the_file_tells(
    settings, name, anisotropy, heaviest
):
    """J^-T M J^-1 over the workspace, without the module: of the robot that is simulated."""
    robot = settings.planar._replace(inertia=name)
    found = planar_params(robot, arm_force(settings.arm), settings.substep).inertia
    axes = []
    for x in numpy.linspace(-0.1905, 0.1905, 21):
        for y in numpy.linspace(-0.2286, 0.2286, 21):
            s = resting_plane(robot, x, y)
            j = numpy.array([[-L1 * math.sin(s.shoulder), -L2 * math.sin(s.elbow)],
                             [L1 * math.cos(s.shoulder), L2 * math.cos(s.elbow)]])  # fmt: skip
            across = found.coupling * math.cos(s.elbow - s.shoulder)
            back = numpy.linalg.inv(j)
            axes.append(numpy.linalg.eigvalsh(
                back.T @ [[found.shoulder, across], [across, found.elbow]] @ back
            ))  # fmt: skip
    least, most = numpy.transpose(axes)
    assert ((most / least).min(), (most / least).max()) == pytest.approx(anisotropy, abs=0.006)
    assert most.max() == pytest.approx(heaviest, abs=0.006)


@pytest.mark.parametrize("x", [0.381 * (i / 20 - 0.5) for i in range(21)])
def test_workspace_lies_inside_the_stops(settings, x):
    r = settings.planar
    for j in range(21):
        s = resting_plane(r, x, 0.457 * (j / 20 - 0.5))
        assert r.shoulder_low < s.shoulder < r.shoulder_high
        assert r.between_low < s.elbow - s.shoulder < r.between_high


def test_point_out_of_reach_is_refused(settings):
    with pytest.raises(ValueError, match="reach"):
        resting_plane(settings.planar, 0.0, -0.4)


def test_torque_meets_the_inertia_of_arm_and_module(slippery):
    """The generalized momentum grows by the torques; the structure, struck, swings about that."""
    s = resting_plane(slippery.robot, 0.05, 0.1)
    after = run(slippery, s, IDLE._replace(shoulder_torque=3.0, elbow_torque=-2.0), 100)
    m11, m12, m22 = inertia(s.shoulder, s.elbow, 0.0)
    joints = numpy.array([[m11, m12], [m12, m22]])
    momentum = joints @ (after.shoulder_velocity, after.elbow_velocity)
    momentum += 5.5 * jacobian(s).T @ (after.handle_vx, after.handle_vy)
    assert momentum / (100 * slippery.dt) == pytest.approx([3.0, -2.0], rel=3e-3)


def test_centrifugal_torques_do_no_work(slippery):
    s = turning(resting_plane(slippery.robot, 0.0, 0.0), -1.5, 1.0)
    before = kinetic(s, 5.5)
    after = run(slippery, s, IDLE, 3000)
    assert kinetic(after, 5.5) + bent(after, slippery.robot) == pytest.approx(before, rel=2e-3)
    assert abs(after.shoulder_velocity + 1.5) > 0.1  # there was something to exchange


@run_settings(max_examples=20)
@given(st.floats(-0.19, 0.19), st.floats(-0.22, 0.22), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_passive_arm_never_gains_energy(plane, x, y, w1, w2):
    s, r = turning(resting_plane(plane.robot, x, y), w1, w2), plane.robot

    def energy(s):
        stretch = max(r.shoulder_low - s.shoulder, s.shoulder - r.shoulder_high, 0.0)
        between = s.elbow - s.shoulder
        fold = max(r.between_low - between, between - r.between_high, 0.0)
        stops = 0.5 * r.stop_stiffness * (stretch * stretch + fold * fold)
        return kinetic(s, r.module_mass) + bent(s, r) + stops + bristles(s, r)

    now = start = energy(s)
    for _ in range(2500):
        s = quick_step(plane, s, IDLE)
        after = energy(s)
        assert after <= now + 1e-5 * start + 1e-12
        now = after
    assert now <= 0.995 * start + 1e-9


@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (0.15, -0.2), (-0.1, 0.2)])
def test_transposed_jacobian_balances_the_hand(settings, x, y):
    """With tau = -J^T F against a hand that pushes F, nothing moves and F is measured."""
    robot, (fx, fy) = settings.planar._replace(friction=0.001), (12.0, -7.0)
    p = planar_params(robot, ArmForce(3.0, 1.0, 0.0, math.inf, 0.0), settings.substep)
    s = resting_plane(robot, x, y)
    torques = {
        "shoulder_torque": L1 * (math.sin(s.shoulder) * fx - math.cos(s.shoulder) * fy),
        "elbow_torque": L2 * (math.sin(s.elbow) * fx - math.cos(s.elbow) * fy),
    }
    u = IDLE._replace(attached=True, hand_x=x + fx, hand_y=y + fy, **torques)
    s = run(p, s._replace(**torques), u, 20_000)
    assert handle_place(robot, s) == pytest.approx((x, y), abs=2e-4)
    assert (s.force_x, s.force_y) == pytest.approx((fx, fy), abs=1e-3)


def test_measured_force_holds_the_reaction_of_the_arm_s_mass(slippery):
    p = slippery._replace(arm=ArmForce(3.0, 0.0, 0.0, math.inf, 0.0))
    u = IDLE._replace(shoulder_torque=4.0, elbow_torque=1.0, attached=True)
    places, forces, s = [], [], resting_plane(p.robot, 0.0, 0.0)
    for _ in range(1000):
        s = quick_step(p, s, u)
        places.append(handle_place(p.robot, s))
        forces.append((s.force_x, s.force_y))
    acceleration = numpy.diff(places, 2, axis=0)[500:] / p.dt**2
    assert numpy.array(forces[502:]) == pytest.approx(-3.0 * acceleration, abs=0.05)


def test_friction_holds_small_torques_and_lets_large_ones_pass(plane):
    s = resting_plane(plane.robot, 0.0, 0.0)
    stuck = run(plane, s, IDLE._replace(shoulder_torque=0.15), 40_000)
    assert abs(stuck.shoulder - s.shoulder) < 2e-3
    assert abs(stuck.shoulder_velocity) < 1e-5
    assert run(plane, s, IDLE._replace(shoulder_torque=0.6), 20_000).shoulder - s.shoulder > 0.02


@pytest.mark.parametrize("torque", [28.0, -28.0])
def test_stops_hold_the_full_motor(plane, torque):
    r, s = plane.robot, resting_plane(plane.robot, 0.0, 0.0)
    for _ in range(20_000):
        s = quick_step(plane, s, IDLE._replace(shoulder_torque=torque, elbow_torque=torque))
        assert r.shoulder_low - 0.15 < s.shoulder < r.shoulder_high + 0.15
        assert r.between_low - 0.15 < s.elbow - s.shoulder < r.between_high + 0.15


def test_no_power_no_torque_and_a_short_brakes(plane):
    s = turning(resting_plane(plane.robot, 0.0, 0.0), 1.0, 1.0)
    off = IDLE._replace(
        shoulder_torque=9.0, elbow_torque=9.0, shoulder_powered=False, elbow_powered=False
    )
    coasting = run(plane, s, off, 4000)
    assert coasting.shoulder_torque == 0.0
    braked = run(plane, s, off._replace(shoulder_braked=True, elbow_braked=True), 4000)
    assert kinetic(braked, 5.5) < 0.8 * kinetic(coasting, 5.5)


def test_torque_saturates(plane):
    s = run(plane, resting_plane(plane.robot, 0.0, 0.0), IDLE._replace(elbow_torque=1e3), 100)
    assert s.elbow_torque == pytest.approx(plane.robot.torque_limit, rel=1e-6)


# The structure ------------------------------------------------------------------------------


def rigid_step(p, s, u):
    """One backward Euler step of an arm that does not bend, written out again.

    s: angles, velocities, bristles. Motors without lag, no stops.
    """
    r, dt, (q1, q2, *w, z1, z2) = p.robot, p.dt, s
    j = jacobian(IDLE_AT._replace(shoulder=q1, elbow=q2))
    mass = r.module_mass + p.arm.mass
    m11, m12, m22 = inertia(q1, q2, mass)
    sine = (0.171 + mass * L1 * L2) * math.sin(q2 - q1)
    torque = numpy.array([u.shoulder_torque + sine * w[1] ** 2, u.elbow_torque - sine * w[0] ** 2])
    a = numpy.array([[m11, m12], [m12, m22]]) / dt
    b = a @ w + torque
    bristles = []
    for joint, (bristle, velocity) in enumerate(((z1, w[0]), (z2, w[1]))):
        keep, slope, micro = bristle_terms(
            r.bristle_stiffness, r.bristle_damping, bristle, velocity, r.friction, dt
        )
        a[joint, joint] += slope + micro + r.viscous
        b[joint] -= keep * bristle
        bristles.append((keep, slope, bristle))
    k, d = p.arm.stiffness, p.arm.damping
    place = numpy.array(tip(r, q1, q2))
    hand, speed = (u.hand_x, u.hand_y), (u.hand_velocity_x, u.hand_velocity_y)
    a += (k * dt + d) * j.T @ j
    b += j.T @ (k * (hand - place) + d * numpy.array(speed))
    v = numpy.linalg.solve(a, b)
    z = [
        settled_bristle(keep * old + slope * v[joint], old, r.friction)
        for joint, (keep, slope, old) in enumerate(bristles)
    ]
    return q1 + dt * v[0], q2 + dt * v[1], *v, *z


def test_a_spring_as_stiff_as_one_likes_is_the_rigid_arm(settings):
    """In a hand that draws a circle against a motor's torques, slow and quick, for 2 s."""
    robot = settings.planar._replace(structure_stiffness=1e12, bandwidth=1e5)
    p = planar_params(robot, ArmForce(3.0, 300.0, 30.0, math.inf, 0.0), settings.substep)
    s = resting_plane(robot, 0.05, 0.0)
    rigid, furthest = (s.shoulder, s.elbow, 0.0, 0.0, 0.0, 0.0), 0.0
    for number in range(40_000):
        angle = 3.0 * number * p.dt
        u = IDLE._replace(
            shoulder_torque=math.sin(2.1 * angle), elbow_torque=-0.5 * math.sin(0.7 * angle),
            attached=True, hand_x=0.05 * math.cos(angle), hand_y=0.05 * math.sin(angle),
            hand_velocity_x=-0.15 * math.sin(angle), hand_velocity_y=0.15 * math.cos(angle),
        )  # fmt: skip
        s, rigid = quick_step(p, s, u), rigid_step(p, rigid, u)
        x, y = handle_place(robot, s)
        expected = tip(robot, rigid[0], rigid[1])
        furthest = max(furthest, math.dist((x, y), expected))
    assert math.dist(tip(robot, s.shoulder, s.elbow), (0.05, 0.0)) > 0.01
    assert furthest < 1e-6


@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (0.15, -0.2), (-0.1, 0.2)])
@pytest.mark.parametrize("stiffness", [5e4, 2e5, 1e6])
def test_a_force_on_the_handle_bends_the_structure_and_the_encoders_do_not_see_it(
    settings, stiffness, x, y
):
    force = (5.0, -3.0)
    robot = settings.planar._replace(
        structure_stiffness=stiffness, friction=10.0, bristle_stiffness=1e6
    )
    p = planar_params(robot, ArmForce(0.0, 1.0, 50.0, math.inf, 0.0), settings.substep)
    s = resting_plane(robot, x, y)
    shoulder, elbow = -jacobian(s).T @ force  # motors and friction hold the joints
    held = s._replace(shoulder_torque=shoulder, elbow_torque=elbow)
    u = IDLE._replace(
        shoulder_torque=shoulder, elbow_torque=elbow, attached=True, hand_x=x + force[0],
        hand_y=y + force[1],
    )  # fmt: skip
    after = run(p, held, u, 20_000)
    moved = numpy.subtract(handle_place(robot, after), (x, y))
    assert moved == pytest.approx(numpy.array(force) / stiffness, rel=2e-3)
    turned = numpy.subtract((after.shoulder, after.elbow), (s.shoulder, s.elbow))
    assert abs(turned).max() < 0.01 * settings.start.joint_resolution


@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (0.15, -0.2), (-0.1, 0.2)])
@pytest.mark.parametrize(("stiffness", "ratio"), [(5e4, 0.02), (2e5, 0.02), (2e5, 0.04)])
@pytest.mark.parametrize("direction", [0, 1])
def test_a_struck_module_swings_on_the_structure(slippery, stiffness, ratio, x, y, direction):
    """In each principal direction with sqrt(k (1 / m + 1 / Lambda)), damped as it is said."""
    robot = slippery.robot._replace(structure_stiffness=stiffness, structure_damping_ratio=ratio)
    p, s = planar_params(robot, slippery.arm, slippery.dt), resting_plane(robot, x, y)
    m11, m12, m22 = inertia(s.shoulder, s.elbow, 0.0)
    j = jacobian(s)
    mobility = j @ numpy.linalg.solve([[m11, m12], [m12, m22]], j.T)
    values, axes = numpy.linalg.eigh(mobility)
    s = s._replace(handle_vx=0.03 * axes[0, direction], handle_vy=0.03 * axes[1, direction])
    bend = []
    for _ in range(4000):
        s = quick_step(p, s, IDLE)
        bend.append(s.bend_x * axes[0, direction] + s.bend_y * axes[1, direction])
    bend = numpy.array(bend)
    up = numpy.flatnonzero((bend[:-1] < 0.0) & (bend[1:] >= 0.0))[:6]  # before friction holds it
    crossings = up + bend[up] / (bend[up] - bend[up + 1])
    omega = 2.0 * math.pi * 5.0 / ((crossings[5] - crossings[0]) * p.dt)
    mobile = 1.0 / 5.5 + values[direction]
    damped = ratio * math.sqrt(5.5 * mobile)
    wanted = math.sqrt(stiffness * mobile * (1.0 - damped * damped))
    assert omega == pytest.approx(wanted, rel=0.01)
    peaks = [bend[a:b].max() for a, b in zip(up, up[1:], strict=False)]
    decay = math.log(peaks[0] / peaks[4]) / (2.0 * math.pi * 4.0)
    assert decay == pytest.approx(damped, rel=0.1)


@example(7.0, 0.0, 0.0, 0.0, 1.96e-5, 0.0)
@run_settings(max_examples=20)
@given(
    st.floats(math.log(1e3), math.log(1e12)), st.floats(0.0, 1.0), st.floats(-1.0, 1.0),
    st.floats(-1.0, 1.0), st.floats(-1e-3, 1e-3), st.floats(-1e-3, 1e-3),
)  # fmt: skip
def test_a_free_structure_never_gains_energy(slippery, stiffness, ratio, vx, vy, bx, by):
    """Whatever its stiffness, damping and start; the module swings, the joints go along."""
    robot = slippery.robot._replace(
        structure_stiffness=math.exp(stiffness), structure_damping_ratio=ratio
    )
    p = planar_params(robot, slippery.arm, slippery.dt)
    shift = min(1.0, 1e3 / robot.structure_stiffness * 1e3)  # at most 1 J to begin with
    s = resting_plane(robot, 0.05, 0.1)
    s = s._replace(handle_vx=vx, handle_vy=vy, bend_x=bx * shift, bend_y=by * shift)
    now = start = kinetic(s, 5.5) + bent(s, robot)
    for _ in range(4000):
        s = quick_step(p, s, IDLE)
        after = kinetic(s, 5.5) + bent(s, robot) + bristles(s, robot)
        assert after <= now + 1e-5 * start + 1e-12
        now = after
    assert now <= start


@pytest.mark.parametrize("mass", [0.0, 5.5])
def test_a_handle_without_mass_follows_the_joints(settings, mass):
    robot = settings.planar._replace(module_mass=mass)
    p = planar_params(robot, arm_force(settings.arm), settings.substep)
    s = run(p, resting_plane(robot, 0.0, 0.0), IDLE._replace(shoulder_torque=2.0), 4000)
    assert math.dist(handle_place(robot, s), (0.0, 0.0)) > 0.01
    assert math.hypot(s.bend_x, s.bend_y) < (1e-9 if mass == 0.0 else 1e-3)
