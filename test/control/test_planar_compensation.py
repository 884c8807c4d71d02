# SPDX-License-Identifier: Apache-2.0
"""Friction and mass that the plane's law can carry for the hand: bounded, and off by default."""

import math

import pytest

from screw_module_ros.control.guard import share_left
from screw_module_ros.control.planar import (
    CHATTER_HZ,
    LARGEST,
    Axis,
    Joint,
    PlanarInput,
    carried_force,
    initial_state,
    joint_friction,
    planar_step,
)
from screw_module_ros.control.planar_settings import CARRIED_HZ, PlanarSettings, least_damping
from screw_module_ros.filters import tune, tune_highpass
from screw_module_ros.geometry import inverse, jacobian

DT = 0.002
PLAIN = PlanarSettings(stiffness=0.0, damping=0.0)


def carried(speed, seconds):
    """Carried force [N] at each tick of a motion with speed(t) [m/s], and the axis."""
    axis, settings = Axis(), PLAIN._replace(carried_mass=3.0)
    tune(axis.speed, CARRIED_HZ, DT)
    tune_highpass(axis.chatter.fast, CHATTER_HZ, DT)
    ticks = range(round(seconds / DT))
    return [carried_force(settings, axis, speed(tick * DT), DT) for tick in ticks], axis


def test_most_of_the_mass_is_carried_at_the_speed_of_a_hand():
    omega, speed = 3.0, 0.24
    forces, axis = carried(lambda t: speed * math.sin(omega * t), 6.0)
    ideal = [3.0 * speed * omega * math.cos(omega * tick * DT) for tick in range(3000)]
    left = [a - b for a, b in zip(ideal[1000:], forces[1000:], strict=True)]
    assert max(map(abs, left)) < 0.15 * 3.0 * speed * omega
    assert share_left(axis.chatter) == 1.0


def test_a_tremor_keeps_the_mass_and_shaking_loses_it():
    _, tremor = carried(lambda t: 0.03 * math.sin(31.4 * t), 2.0)
    _, shaking = carried(lambda t: 0.1 * math.sin(80.0 * t), 2.0)
    assert share_left(tremor.chatter) == 1.0
    assert share_left(shaking.chatter) == 0.0


def test_nothing_is_carried_on_a_handle_that_only_quivers():
    """One count of the joints to and fro, as on a stiff wall, where it kept an oscillation up."""
    forces, _ = carried(lambda t: 0.003 * math.sin(120.0 * t), 2.0)
    assert max(map(abs, forces)) < 0.1


def test_a_jolt_gives_no_more_than_the_limit():
    forces, _ = carried(lambda t: 3.0 if t > 0.1 else 0.0, 0.2)
    assert max(forces) == LARGEST


RUBBING = PLAIN._replace(joint_friction=0.24)


def friction_after(*angles, settings=RUBBING):
    """Torques [Nm] at these angles [rad], from rest at the first one."""
    joint = Joint(angles[0])
    return [joint_friction(settings, joint, angle) for angle in angles[1:]]


def test_friction_follows_the_angle_and_exchanges_no_energy_at_rest():
    angles = [1e-3 * math.sin(0.01 * tick) for tick in range(round(4.0 * math.pi / 0.01) + 1)]
    torques = [0.0, *friction_after(*angles)]
    work = sum(
        0.5 * (torques[k] + torques[k + 1]) * (angles[k + 1] - angles[k])
        for k in range(len(angles) - 1)
    )
    assert work < 4.0 * 2.0 * 1e-3 * 0.24, "never more than the friction itself takes"
    begun, held = friction_after(0.0, 1e-3, 1e-3)
    assert begun == held > 0.05
    assert friction_after(0.0, 1.0) == [pytest.approx(0.24)]
    assert friction_after(0.0, -1.0) == [pytest.approx(-0.24)]
    assert friction_after(0.0, 1.0, settings=PLAIN) == [0.0]


def test_friction_that_is_set_lower_is_lower_at_once():
    joint = Joint()
    joint_friction(RUBBING, joint, 1.0)
    assert joint_friction(PLAIN._replace(joint_friction=0.1), joint, 1.0) == 0.1


def test_least_damping_is_for_carried_mass_only():
    assert least_damping(PLAIN, 100.0) == 0.0
    assert 3.0 < least_damping(PLAIN._replace(carried_mass=3.0), 100.0) < 10.0


def torques(settings, speeds):
    """Torques of the law along a motion of both joints with these speeds [rad/s]."""
    shoulder, elbow = inverse(0.0, 0.0)
    state, out = initial_state(settings), []
    for speed in speeds:
        inp = PlanarInput(
            shoulder, elbow, speed, speed, math.nan, math.nan, math.nan, math.nan, True
        )
        output = planar_step(settings, state, inp, DT)
        out.append((output.shoulder_torque, output.elbow_torque))
        shoulder, elbow = shoulder + speed * DT, elbow + speed * DT
    return out


def test_off_by_default_and_in_the_direction_of_motion():
    speeds = [0.2] * 400
    assert set(torques(PLAIN, speeds)) == {(0.0, 0.0)}
    shoulder, elbow = torques(PLAIN._replace(joint_friction=0.2), speeds)[-1]
    assert (shoulder, elbow) == (pytest.approx(0.2, rel=0.02), pytest.approx(0.2, rel=0.02))


def test_no_jump_of_the_torque_when_it_is_switched_on():
    settings = PLAIN._replace(joint_friction=0.3, carried_mass=3.0)
    speeds = [0.5 * math.sin(3.0 * tick * DT) for tick in range(1500)]
    found = torques(settings, speeds)
    largest = PLAIN.torque_rate * DT
    for before, after in zip(found, found[1:], strict=False):
        assert all(abs(b - a) <= largest + 1e-9 for a, b in zip(before, after, strict=True))


def test_carried_force_goes_along_the_acceleration_of_the_handle():
    speeds = [0.5 * math.sin(3.0 * tick * DT) for tick in range(1100)]
    found = torques(PLAIN._replace(carried_mass=3.0), speeds)
    x_s, x_e, y_s, y_e = jacobian(*inverse(0.0, 0.0))
    acceleration = 1.5 * math.cos(3.0 * 1099 * DT)  # of both joints [rad/s^2]
    ax, ay = (x_s + x_e) * acceleration, (y_s + y_e) * acceleration
    wanted = 3.0 * (x_s * ax + y_s * ay), 3.0 * (x_e * ax + y_e * ay)
    for torque, ideal in zip(found[-1], wanted, strict=True):
        assert torque * ideal > 0.0
        assert abs(torque) < 1.2 * abs(ideal)
