# SPDX-License-Identifier: Apache-2.0
"""MIT-MANUS in the plane, carrying the vertical module at its tip.

Both joint angles are absolute (the motors stand at the base; frame `manus_base`, counter-clockwise
from +x), so with D = elbow - shoulder the arm's inertia is [[a, c cos D], [c cos D, b]] and a mass
m at the tip adds m J^T J, of the same form. The base stands beyond the workspace, opposite the
patient (thesis 1.1). Motor torques, a little joint friction, stops and the
patient's hand act on it; one substep solves both joint velocities implicitly (backward Euler).
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from ..settings import Setting
from .friction import bristle_terms, settled_bristle
from .patient import ArmForce, spring_terms

INERTIAS = ("appendix_d", "inmotion2")
"""Named sets of joint inertias: a robot is one or the other."""


class JointInertia(NamedTuple):
    """M(q) = [[shoulder, coupling cos D], [coupling cos D, elbow]], without the module."""

    shoulder: Annotated[float, Setting("M11", "kg m^2", 0.01, 10.0)]
    elbow: Annotated[float, Setting("M22", "kg m^2", 0.01, 10.0)]
    coupling: Annotated[float, Setting("M12 / cos D", "kg m^2", 0.0, 10.0)]


class Planar(NamedTuple):
    """The planar arm. inertia: which of the sets `appendix_d` and `inmotion2` it has."""

    upper_arm: Annotated[float, Setting("length", "m", 0.05, 2.0)]
    forearm: Annotated[float, Setting("length", "m", 0.05, 2.0)]
    base_x: Annotated[float, Setting("base from the workspace centre", "m", -2.0, 2.0)]
    base_y: Annotated[float, Setting("base from the workspace centre", "m", -2.0, 2.0)]
    elbow: Annotated[
        str, Setting("side of the elbow, seen by the patient", choices=("right", "left"))
    ]
    inertia: Annotated[str, Setting("the set of joint inertias", choices=INERTIAS)]
    appendix_d: JointInertia
    inmotion2: JointInertia
    module_mass: Annotated[float, Setting("vertical module at the tip", "kg", 0.0, 50.0)]
    friction: Annotated[float, Setting("of each joint", "Nm", 0.001, 10.0)]
    viscous: Annotated[float, Setting("of each joint", "Nm s/rad", 0.0, 10.0)]
    bristle_stiffness: Annotated[float, Setting("before slip", "Nm/rad", 1.0, 1e6)]
    bristle_damping: Annotated[float, Setting("before slip", "Nm s/rad", 0.0, 1e3)]
    torque_limit: Annotated[float, Setting("amplifier saturation", "Nm", 0.1, 1e3)]
    bandwidth: Annotated[float, Setting("torque loop, first order", "Hz", 10.0, 1e5)]
    brake_damping: Annotated[float, Setting("shorted motor", "Nm s/rad", 0.0, 100.0)]
    shoulder_low: Annotated[float, Setting("stop", "rad", -7.0, 7.0)]
    shoulder_high: Annotated[float, Setting("stop", "rad", -7.0, 7.0)]
    between_low: Annotated[float, Setting("stop of elbow - shoulder", "rad", -3.14, 3.14)]
    between_high: Annotated[float, Setting("stop of elbow - shoulder", "rad", -3.14, 3.14)]
    stop_stiffness: Annotated[float, Setting("stops", "Nm/rad", 1.0, 1e6)]
    stop_damping: Annotated[float, Setting("stops", "Nm s/rad", 0.0, 1e4)]

    @property
    def joint_inertia(self) -> JointInertia:
        """The set that this robot has."""
        return getattr(self, self.inertia)

    @property
    def turn(self) -> float:
        """Sign of elbow - shoulder with the elbow on its side.

        The elbow is to the right of the line from the base to the centre where the forearm turns
        on clockwise from a base beyond the workspace, or counter-clockwise from one before it.
        """
        to_the_right = -1.0 if self.base_y > 0.0 else 1.0
        return to_the_right if self.elbow == "right" else -to_the_right


class PlanarParams(NamedTuple):
    """Everything `planar_step` needs; keep: decay of the torque loop over dt [s]."""

    robot: Planar
    inertia: JointInertia
    arm: ArmForce
    keep: float
    dt: float


class ManusInput(NamedTuple):
    """Inputs of a substep: torque commands [Nm], power and brakes, the hand.

    attached: a hand holds the handle; hand_*: virtual hand from the workspace centre [m], [m/s].
    """

    shoulder_torque: float
    elbow_torque: float
    shoulder_powered: bool
    elbow_powered: bool
    shoulder_braked: bool
    elbow_braked: bool
    attached: bool
    hand_x: float
    hand_y: float
    hand_velocity_x: float
    hand_velocity_y: float


class ManusState(NamedTuple):
    """Angles [rad], velocities [rad/s], friction bristles and motor torques [Nm], hand force [N].

    force_x, force_y: patient on robot.
    """

    shoulder: float
    elbow: float
    shoulder_velocity: float
    elbow_velocity: float
    shoulder_bristle: float
    elbow_bristle: float
    shoulder_torque: float
    elbow_torque: float
    force_x: float
    force_y: float


def planar_params(robot: Planar, arm: ArmForce, dt: float) -> PlanarParams:
    """Return the parameters of `planar_step` for substeps of dt [s]."""
    keep = math.exp(-2.0 * math.pi * robot.bandwidth * dt)
    return PlanarParams(robot, robot.joint_inertia, arm, keep, dt)


def resting_plane(robot: Planar, x: float, y: float) -> ManusState:
    """Return the arm at rest with the handle at x, y [m], the elbow on its side.

    Raises ValueError when the point is out of reach.
    """
    dx, dy = x - robot.base_x, y - robot.base_y
    l1, l2 = robot.upper_arm, robot.forearm
    cosine = (dx * dx + dy * dy - l1 * l1 - l2 * l2) / (2.0 * l1 * l2)
    if abs(cosine) > 1.0:
        raise ValueError(f"x = {x:g}, y = {y:g} m is out of reach of the planar arm")
    between = robot.turn * math.acos(cosine)
    shoulder = math.atan2(dy, dx) - math.atan2(l2 * math.sin(between), l1 + l2 * cosine)
    zeros = ManusState(*(0.0,) * len(ManusState._fields))
    return zeros._replace(shoulder=shoulder, elbow=shoulder + between)


def tip(robot: Planar, shoulder: float, elbow: float) -> tuple[float, float]:
    """Return the handle's x, y from the workspace centre [m]."""
    return (
        robot.base_x + robot.upper_arm * math.cos(shoulder) + robot.forearm * math.cos(elbow),
        robot.base_y + robot.upper_arm * math.sin(shoulder) + robot.forearm * math.sin(elbow),
    )


class _Hand(NamedTuple):
    """The hand over one substep: force = steady - gain x velocity at the tip [N], and mass [kg]."""

    gain_x: float
    gain_y: float
    steady_x: float
    steady_y: float
    mass: float


class _Joints(NamedTuple):
    """Friction, brakes and stops over one substep: torque = steady - damping x velocity [Nm].

    keep, slope: of the bristles; between_*: between the links, on the elbow.
    """

    keep_1: float
    slope_1: float
    damping_1: float
    steady_1: float
    keep_2: float
    slope_2: float
    damping_2: float
    steady_2: float
    between_damping: float
    between_steady: float


def planar_step(p: PlanarParams, s: ManusState, u: ManusInput) -> ManusState:
    """Advance the planar arm by one substep of p.dt."""
    r = p.robot
    dt = p.dt
    w1, w2 = s.shoulder_velocity, s.elbow_velocity
    cos_1, sin_1 = math.cos(s.shoulder), math.sin(s.shoulder)
    cos_2, sin_2 = math.cos(s.elbow), math.sin(s.elbow)
    j11, j12 = -r.upper_arm * sin_1, -r.forearm * sin_2
    j21, j22 = r.upper_arm * cos_1, r.forearm * cos_2
    hand = _hand_terms(p, u, j21 + j22, -j11 - j12, j11 * w1 + j12 * w2, j21 * w1 + j22 * w2)
    joints = _joint_terms(p, s, u)
    torque_1 = _motor(p, s.shoulder_torque, u.shoulder_torque, u.shoulder_powered)
    torque_2 = _motor(p, s.elbow_torque, u.elbow_torque, u.elbow_powered)

    mass = r.module_mass + hand.mass
    m11 = p.inertia.shoulder + mass * r.upper_arm * r.upper_arm
    m22 = p.inertia.elbow + mass * r.forearm * r.forearm
    coupled = p.inertia.coupling + mass * r.upper_arm * r.forearm
    m12 = coupled * (cos_1 * cos_2 + sin_1 * sin_2)
    turning = coupled * (sin_2 * cos_1 - cos_2 * sin_1)  # centrifugal torques, from sin D

    a11 = m11 / dt + joints.damping_1 + hand.gain_x * j11 * j11 + hand.gain_y * j21 * j21
    a12 = m12 / dt + hand.gain_x * j11 * j12 + hand.gain_y * j21 * j22
    a22 = m22 / dt + joints.damping_2 + hand.gain_x * j12 * j12 + hand.gain_y * j22 * j22
    a11 += joints.between_damping
    a12 -= joints.between_damping
    a22 += joints.between_damping
    b1 = (m11 * w1 + m12 * w2) / dt + turning * w2 * w2 + torque_1 + joints.steady_1
    b2 = (m12 * w1 + m22 * w2) / dt - turning * w1 * w1 + torque_2 + joints.steady_2
    b1 += j11 * hand.steady_x + j21 * hand.steady_y - joints.between_steady
    b2 += j12 * hand.steady_x + j22 * hand.steady_y + joints.between_steady
    determinant = a11 * a22 - a12 * a12
    v1 = (a22 * b1 - a12 * b2) / determinant
    v2 = (a11 * b2 - a12 * b1) / determinant

    d1, d2 = (v1 - w1) / dt, (v2 - w2) / dt
    acceleration_x = j11 * d1 + j12 * d2 - j21 * w1 * w1 - j22 * w2 * w2
    acceleration_y = j21 * d1 + j22 * d2 + j11 * w1 * w1 + j12 * w2 * w2
    bent_1 = joints.keep_1 * s.shoulder_bristle + joints.slope_1 * v1
    bent_2 = joints.keep_2 * s.elbow_bristle + joints.slope_2 * v2
    return ManusState(
        s.shoulder + dt * v1,
        s.elbow + dt * v2,
        v1,
        v2,
        settled_bristle(bent_1, s.shoulder_bristle, r.friction),
        settled_bristle(bent_2, s.elbow_bristle, r.friction),
        torque_1,
        torque_2,
        hand.steady_x - hand.gain_x * (j11 * v1 + j12 * v2) - hand.mass * acceleration_x,
        hand.steady_y - hand.gain_y * (j21 * v1 + j22 * v2) - hand.mass * acceleration_y,
    )


def _motor(p: PlanarParams, torque: float, command: float, powered: bool) -> float:
    """Return the motor torque after a substep [Nm]."""
    wanted = 0.0
    if powered:
        wanted = min(max(command, -p.robot.torque_limit), p.robot.torque_limit)
    return wanted + (torque - wanted) * p.keep


def _hand_terms(
    p: PlanarParams, u: ManusInput, reach_x: float, reach_y: float, vx: float, vy: float
) -> _Hand:
    """Return the hand's terms for the tip at reach_x, reach_y from the base [m], velocity v."""
    if not u.attached:
        return _Hand(0.0, 0.0, 0.0, 0.0, 0.0)
    x = p.robot.base_x + reach_x
    y = p.robot.base_y + reach_y
    stiffness_x, viscous_x, steady_x = spring_terms(p.arm, u.hand_x, u.hand_velocity_x, x, vx)
    stiffness_y, viscous_y, steady_y = spring_terms(p.arm, u.hand_y, u.hand_velocity_y, y, vy)
    return _Hand(
        stiffness_x * p.dt + viscous_x,
        stiffness_y * p.dt + viscous_y,
        steady_x + stiffness_x * (u.hand_x - x) + viscous_x * u.hand_velocity_x,
        steady_y + stiffness_y * (u.hand_y - y) + viscous_y * u.hand_velocity_y,
        p.arm.mass,
    )


def _joint_terms(p: PlanarParams, s: ManusState, u: ManusInput) -> _Joints:
    """Return friction, brakes and stops of both joints."""
    r = p.robot
    keep_1, slope_1, micro_1 = bristle_terms(
        r.bristle_stiffness, r.bristle_damping, s.shoulder_bristle, s.shoulder_velocity,
        r.friction, p.dt,
    )  # fmt: skip
    keep_2, slope_2, micro_2 = bristle_terms(
        r.bristle_stiffness, r.bristle_damping, s.elbow_bristle, s.elbow_velocity,
        r.friction, p.dt,
    )  # fmt: skip
    brake_1 = r.brake_damping if u.shoulder_braked else 0.0
    brake_2 = r.brake_damping if u.elbow_braked else 0.0
    stop, stop_gain = _stop_terms(p, r.shoulder_low, r.shoulder_high, s.shoulder,
                                  s.shoulder_velocity)  # fmt: skip
    between, between_gain = _stop_terms(p, r.between_low, r.between_high, s.elbow - s.shoulder,
                                        s.elbow_velocity - s.shoulder_velocity)  # fmt: skip
    return _Joints(
        keep_1,
        slope_1,
        slope_1 + micro_1 + r.viscous + brake_1 + stop_gain,
        stop - keep_1 * s.shoulder_bristle,
        keep_2,
        slope_2,
        slope_2 + micro_2 + r.viscous + brake_2,
        -keep_2 * s.elbow_bristle,
        between_gain,
        between,
    )


def _stop_terms(
    p: PlanarParams, low: float, high: float, angle: float, velocity: float
) -> tuple[float, float]:
    """Return (stop torque at the present angle [Nm], damping over this substep [Nm s/rad])."""
    r = p.robot
    ahead = angle + p.dt * velocity
    if low <= ahead <= high:
        return 0.0, 0.0
    depth = low - angle if ahead < low else high - angle
    push = r.stop_stiffness * (depth - p.dt * velocity) - r.stop_damping * velocity
    if push * (low + high - 2.0 * ahead) <= 0.0:  # a stop does not pull
        return 0.0, 0.0
    return r.stop_stiffness * depth, r.stop_stiffness * p.dt + r.stop_damping
