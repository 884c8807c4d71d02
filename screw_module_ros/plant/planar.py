# SPDX-License-Identifier: Apache-2.0
"""MIT-MANUS in the plane, carrying the vertical module on a structure that bends.

Both joint angles are absolute (the motors stand at the base; frame `manus_base`, counter-clockwise
from +x), so with D = elbow - shoulder the arm's inertia is [[a, c cos D], [c cos D, b]]. The
base stands beyond the workspace, opposite the patient (thesis 1.1). Motor torques, a little joint
friction and stops act on the joints, whose encoders see them alone. Links, bearings and flange
bend: between the joints' tip p(q) and the handle is a spring with a damper, the same in x and y.
The module's mass m, the handle with its force sensor and the hand's mass m_h lie
beyond it. With J = dp/dq, the deflection b and the handle's velocity v

    M(q) q'' + c(q, q') = torques + J^T s,    s = k b + d b',    b' = v - J q',
    (m + m_h) v' = F - s

with F of the hand's spring and damper; the handle stands at p(q) + b. One substep solves all four
velocities implicitly, so spring and damper only take energy, and a spring as stiff as one likes
leaves the rigid arm, without another step for it.
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
    module_mass: Annotated[float, Setting("vertical module beyond the spring", "kg", 0.0, 50.0)]
    structure_stiffness: Annotated[
        float, Setting("from the joints to the module, in each direction", "N/m", 1e3, 1e13)
    ]
    structure_damping_ratio: Annotated[
        float, Setting("of the module on this spring, joints held", "", 0.0, 1.0)
    ]
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
    """Everything `planar_step` needs; keep: decay of the torque loop over dt [s];
    structure_gain: of the structure's force to its velocity after a substep [N s/m]."""

    robot: Planar
    inertia: JointInertia
    arm: ArmForce
    keep: float
    structure_gain: float
    dt: float


class ManusInput(NamedTuple):
    """Inputs of a substep: torque commands [Nm], power and brakes, the hand.

    attached: a hand holds the handle; hand_*: virtual hand from the workspace centre [m], [m/s];
    pull_y: force of the hand beside its spring and damper [N]; vigour: share of its strength.
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
    pull_y: float
    vigour: float


class ManusState(NamedTuple):
    """Angles [rad], velocities [rad/s], friction bristles and motor torques [Nm] of the joints.

    bend_x, bend_y: the handle from the joints' tip [m]; handle_vx, handle_vy: its velocity [m/s];
    force_x, force_y: patient on robot [N].
    """

    shoulder: float
    elbow: float
    shoulder_velocity: float
    elbow_velocity: float
    shoulder_bristle: float
    elbow_bristle: float
    shoulder_torque: float
    elbow_torque: float
    bend_x: float
    bend_y: float
    handle_vx: float
    handle_vy: float
    force_x: float
    force_y: float


def planar_params(robot: Planar, arm: ArmForce, dt: float) -> PlanarParams:
    """Return the parameters of `planar_step` for substeps of dt [s].

    A substep's structure force is k b + g v, with the deflection b before it and the velocity v
    after it. That is a spring with a damper g, without a damping of the integration's own. From
    g = k dt / 2 on it never adds energy, and with k dt it is backward Euler, which a spring of any
    stiffness wants. At 50 us the damper is larger than that up to 3.5e6 N/m with a ratio of 0.02.
    """
    stiffness = robot.structure_stiffness
    damping = 2.0 * robot.structure_damping_ratio * math.sqrt(stiffness * robot.module_mass)
    keep = math.exp(-2.0 * math.pi * robot.bandwidth * dt)
    return PlanarParams(robot, robot.joint_inertia, arm, keep, max(damping, stiffness * dt), dt)


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
    """Return x, y of the joints' tip from the workspace centre [m]: the handle's, if unloaded."""
    return (
        robot.base_x + robot.upper_arm * math.cos(shoulder) + robot.forearm * math.cos(elbow),
        robot.base_y + robot.upper_arm * math.sin(shoulder) + robot.forearm * math.sin(elbow),
    )


def handle_place(robot: Planar, s: ManusState) -> tuple[float, float]:
    """Return x, y of the handle from the workspace centre [m]."""
    x, y = tip(robot, s.shoulder, s.elbow)
    return x + s.bend_x, y + s.bend_y


def motor_torques(
    robot: Planar, s: ManusState, shoulder_braked: bool, elbow_braked: bool
) -> tuple[float, float]:
    """Return the torques of both motors on the joints [Nm], brakes included."""
    brake = robot.brake_damping
    return (
        s.shoulder_torque - (brake * s.shoulder_velocity if shoulder_braked else 0.0),
        s.elbow_torque - (brake * s.elbow_velocity if elbow_braked else 0.0),
    )


class _Hand(NamedTuple):
    """The hand over one substep: force = steady - gain x velocity of the handle [N], and mass [kg].
    """

    gain_x: float
    gain_y: float
    steady_x: float
    steady_y: float
    mass: float


class _Carried(NamedTuple):
    """Handle and structure over one substep, along one axis.

    The handle's velocity is free + share x that of the joints' tip [m/s]; the joints' tip feels the
    force steady - gain x its velocity [N].
    """

    free: float
    share: float
    steady: float
    gain: float


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
    hand = _hand_terms(p, s, u, j21 + j22, -j11 - j12)
    joints = _joint_terms(p, s, u)
    torque_1 = _motor(p, s.shoulder_torque, u.shoulder_torque, u.shoulder_powered)
    torque_2 = _motor(p, s.elbow_torque, u.elbow_torque, u.elbow_powered)
    carried = (r.module_mass + hand.mass) / dt
    along_x = _carried(p, carried, s.handle_vx, s.bend_x, hand.gain_x, hand.steady_x)
    along_y = _carried(p, carried, s.handle_vy, s.bend_y, hand.gain_y, hand.steady_y)

    m11, m22, coupling = p.inertia.shoulder, p.inertia.elbow, p.inertia.coupling
    m12 = coupling * (cos_1 * cos_2 + sin_1 * sin_2)
    turning = coupling * (sin_2 * cos_1 - cos_2 * sin_1)  # centrifugal torques, from sin D
    a11 = m11 / dt + joints.damping_1 + joints.between_damping
    a12 = m12 / dt - joints.between_damping
    a22 = m22 / dt + joints.damping_2 + joints.between_damping
    a11 += along_x.gain * j11 * j11 + along_y.gain * j21 * j21
    a12 += along_x.gain * j11 * j12 + along_y.gain * j21 * j22
    a22 += along_x.gain * j12 * j12 + along_y.gain * j22 * j22
    b1 = (m11 * w1 + m12 * w2) / dt + turning * w2 * w2
    b2 = (m12 * w1 + m22 * w2) / dt - turning * w1 * w1
    b1 += torque_1 + joints.steady_1 - joints.between_steady
    b2 += torque_2 + joints.steady_2 + joints.between_steady
    b1 += j11 * along_x.steady + j21 * along_y.steady
    b2 += j12 * along_x.steady + j22 * along_y.steady
    determinant = a11 * a22 - a12 * a12
    v1 = (a22 * b1 - a12 * b2) / determinant
    v2 = (a11 * b2 - a12 * b1) / determinant

    tip_x, tip_y = j11 * v1 + j12 * v2, j21 * v1 + j22 * v2
    vx = along_x.free + along_x.share * tip_x
    vy = along_y.free + along_y.share * tip_y
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
        s.bend_x + dt * (vx - tip_x),
        s.bend_y + dt * (vy - tip_y),
        vx,
        vy,
        hand.steady_x - hand.gain_x * vx - hand.mass * (vx - s.handle_vx) / dt,
        hand.steady_y - hand.gain_y * vy - hand.mass * (vy - s.handle_vy) / dt,
    )


def _carried(
    p: PlanarParams, inertia: float, velocity: float, bend: float, gain: float, push: float
) -> _Carried:
    """Return handle and structure along one axis, after the handle's velocity is eliminated.

    inertia: of module and hand over dt [kg/s]; velocity: of the handle [m/s]; bend [m]; the hand
    pushes with push - gain x velocity [N].
    """
    coupled = p.structure_gain
    held = inertia + gain  # 0 of a handle without mass that nobody holds: it follows the tip
    drive = inertia * velocity + push
    sprung = p.robot.structure_stiffness * bend
    share = coupled / (held + coupled)
    return _Carried(
        (drive - sprung) / (held + coupled),
        share,
        share * drive + (1.0 - share) * sprung,
        share * held,
    )


def _motor(p: PlanarParams, torque: float, command: float, powered: bool) -> float:
    """Return the motor torque after a substep [Nm]."""
    wanted = 0.0
    if powered:
        wanted = min(max(command, -p.robot.torque_limit), p.robot.torque_limit)
    return wanted + (torque - wanted) * p.keep


def _hand_terms(
    p: PlanarParams, s: ManusState, u: ManusInput, reach_x: float, reach_y: float
) -> _Hand:
    """Return the hand's terms, with the joints' tip at reach_x, reach_y from the base [m]."""
    if not u.attached:
        return _Hand(0.0, 0.0, 0.0, 0.0, 0.0)
    x = p.robot.base_x + reach_x + s.bend_x
    y = p.robot.base_y + reach_y + s.bend_y
    stiffness_x, viscous_x, steady_x = spring_terms(
        p.arm, u.hand_x, u.hand_velocity_x, x, s.handle_vx, u.vigour, 1.0
    )
    stiffness_y, viscous_y, steady_y = spring_terms(
        p.arm, u.hand_y, u.hand_velocity_y, y, s.handle_vy, u.vigour, p.arm.extension
    )
    return _Hand(
        stiffness_x * p.dt + viscous_x,
        stiffness_y * p.dt + viscous_y,
        steady_x + stiffness_x * (u.hand_x - x) + viscous_x * u.hand_velocity_x,
        steady_y + u.pull_y + stiffness_y * (u.hand_y - y) + viscous_y * u.hand_velocity_y,
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
