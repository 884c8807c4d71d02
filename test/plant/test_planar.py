# SPDX-License-Identifier: Apache-2.0
"""The planar arm: inertia with the module, energy, J^T F, friction, stops."""

from __future__ import annotations

import functools
import math

import numpy
import pytest
from hypothesis import given
from hypothesis import settings as run_settings
from hypothesis import strategies as st

from screw_module_ros.compiled import compiled, packed
from screw_module_ros.plant.patient import ArmForce, arm_force
from screw_module_ros.plant.planar import (
    ManusInput,
    planar_params,
    planar_step,
    resting_plane,
    tip,
)

pytestmark = pytest.mark.long

L1, L2 = 0.4064, 0.51435
IDLE = ManusInput(0.0, 0.0, True, True, False, False, False, 0.0, 0.0, 0.0, 0.0)



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
    m11, m12, m22 = inertia(s.shoulder, s.elbow, mass)
    w1, w2 = s.shoulder_velocity, s.elbow_velocity
    return 0.5 * (m11 * w1 * w1 + 2.0 * m12 * w1 * w2 + m22 * w2 * w2)


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
    found = planar_params(robot, arm_force(settings.arm, 9.81), settings.substep).inertia
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
    s = resting_plane(slippery.robot, 0.05, 0.1)
    m11, m12, m22 = inertia(s.shoulder, s.elbow, 5.5)
    after = run(slippery, s, IDLE._replace(shoulder_torque=3.0, elbow_torque=-2.0), 100)
    gained = numpy.array([after.shoulder_velocity, after.elbow_velocity]) / (100 * slippery.dt)
    wanted = numpy.linalg.solve([[m11, m12], [m12, m22]], [3.0, -2.0])
    assert gained == pytest.approx(wanted, rel=3e-3)


def test_centrifugal_torques_do_no_work(slippery):
    s = resting_plane(slippery.robot, 0.0, 0.0)._replace(shoulder_velocity=-1.5, elbow_velocity=1.0)
    before = kinetic(s, 5.5)
    after = run(slippery, s, IDLE, 3000)
    assert kinetic(after, 5.5) == pytest.approx(before, rel=2e-3)
    assert abs(after.shoulder_velocity + 1.5) > 0.1  # there was something to exchange


@run_settings(max_examples=20)
@given(st.floats(-0.19, 0.19), st.floats(-0.22, 0.22), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_passive_arm_never_gains_energy(plane, x, y, w1, w2):
    s = resting_plane(plane.robot, x, y)._replace(shoulder_velocity=w1, elbow_velocity=w2)
    r = plane.robot

    def energy(s):
        stretch = max(r.shoulder_low - s.shoulder, s.shoulder - r.shoulder_high, 0.0)
        between = s.elbow - s.shoulder
        fold = max(r.between_low - between, between - r.between_high, 0.0)
        stops = 0.5 * r.stop_stiffness * (stretch * stretch + fold * fold)
        bent = (s.shoulder_bristle**2 + s.elbow_bristle**2) / (2.0 * r.bristle_stiffness)
        return kinetic(s, r.module_mass) + stops + bent

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
    assert tip(robot, s.shoulder, s.elbow) == pytest.approx((x, y), abs=1e-4)
    assert (s.force_x, s.force_y) == pytest.approx((fx, fy), abs=1e-3)


def test_measured_force_holds_the_reaction_of_the_arm_s_mass(slippery):
    p = slippery._replace(arm=ArmForce(3.0, 0.0, 0.0, math.inf, 0.0))
    u = IDLE._replace(shoulder_torque=4.0, elbow_torque=1.0, attached=True)
    places, forces, s = [], [], resting_plane(p.robot, 0.0, 0.0)
    for _ in range(1000):
        s = quick_step(p, s, u)
        places.append(tip(p.robot, s.shoulder, s.elbow))
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
    s = resting_plane(plane.robot, 0.0, 0.0)._replace(shoulder_velocity=1.0, elbow_velocity=1.0)
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
