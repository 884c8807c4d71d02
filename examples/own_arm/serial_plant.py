# SPDX-License-Identifier: Apache-2.0
"""The serial arm's physics, for the simulated rig: written apart, it shares nothing with the arm
that the robot knows. Two bars, the module as a point at the tip, friction in both joints."""

import cmath
import math
from typing import NamedTuple

from screw_module_ros.plant.planar import ManusState
from screw_module_ros.plant.plane_plant import PlanePlant


class Bars(NamedTuple):
    """Lengths [m], masses of bars and module [kg], friction [Nm], damping and brake [Nm s/rad]."""

    length_1: float = 0.42
    length_2: float = 0.45
    base: float = 0.60
    mass_1: float = 1.2
    mass_2: float = 0.8
    module: float = 5.5
    friction: float = 0.15
    viscous: float = 0.05
    brake: float = 2.0
    torque_limit: float = 30.0


class Params(NamedTuple):
    """The arm, and the patient's: stiffness [N/m], damping [Ns/m], mass [kg], limit [N], its share
    away from the body; dt [s]."""

    bars: Bars
    stiffness: float
    damping: float
    mass: float
    limit: float
    extension: float
    dt: float


def tip(bars, state):
    """x + iy of the handle: the bars as complex numbers."""
    turned = cmath.exp(1j * state.shoulder)
    bent = cmath.exp(1j * state.elbow)
    return 1j * bars.base + turned * (bars.length_1 + bars.length_2 * bent)


def place(bars, state):
    """x, y of the handle [m]."""
    at = tip(bars, state)
    return at.real, at.imag


def rest(bars, x, y):
    """At rest with the handle at x, y [m]: where two circles meet, the elbow with the larger x."""
    base, to = complex(0.0, bars.base), complex(x, y)
    way = to - base
    far = abs(way)
    if not abs(bars.length_1 - bars.length_2) < far < bars.length_1 + bars.length_2:
        raise ValueError(f"x = {x:g}, y = {y:g} m is out of reach of the serial arm")
    along = (bars.length_1**2 - bars.length_2**2 + far * far) / (2.0 * far)
    aside = math.sqrt(bars.length_1**2 - along * along)
    elbow = max((base + way / far * complex(along, s) for s in (aside, -aside)),
                key=lambda point: point.real)  # fmt: skip
    first, second = cmath.phase(elbow - base), cmath.phase((to - elbow) / (elbow - base))
    return ManusState(first, second, *(0.0,) * 12)


def params(bars, hand, dt):
    """Numbers of a substep of dt [s] with this arm of the patient."""
    return Params(bars, hand.stiffness, hand.damping, hand.mass, hand.limit, hand.extension, dt)


def step(p, s, u):
    """A substep further: torques of motors, friction and hand; the velocities first (Euler)."""
    b, w1, w2 = p.bars, s.shoulder_velocity, s.elbow_velocity
    at = tip(b, s)
    swing = 1j * (at - 1j * b.base)
    bend = 1j * b.length_2 * cmath.exp(1j * (s.shoulder + s.elbow))
    moves = swing * w1 + bend * w2
    load = b.module + (p.mass if u.attached else 0.0)
    force_x = force_y = 0.0
    if u.attached:
        force_x = p.stiffness * (u.hand_x - at.real) + p.damping * (u.hand_velocity_x - moves.real)
        force_y = p.stiffness * (u.hand_y - at.imag) + p.damping * (u.hand_velocity_y - moves.imag)
        limit = p.limit * u.vigour
        force_x = min(max(force_x, -limit), limit)
        force_y = min(max(force_y, -limit), limit * p.extension) + u.pull_y
    motor_1 = min(max(u.shoulder_torque, -b.torque_limit), b.torque_limit) * u.shoulder_powered
    motor_2 = min(max(u.elbow_torque, -b.torque_limit), b.torque_limit) * u.elbow_powered
    drag_1 = b.friction * math.tanh(50.0 * w1) + (b.viscous + b.brake * u.shoulder_braked) * w1
    drag_2 = b.friction * math.tanh(50.0 * w2) + (b.viscous + b.brake * u.elbow_braked) * w2
    torque_1 = motor_1 - drag_1 + swing.real * force_x + swing.imag * force_y
    torque_2 = motor_2 - drag_2 + bend.real * force_x + bend.imag * force_y

    outer = (b.mass_2 / 3.0 + load) * b.length_2**2
    inner = (b.mass_1 / 3.0 + b.mass_2 + load) * b.length_1**2
    coupled = (b.mass_2 / 2.0 + load) * b.length_1 * b.length_2
    m22 = outer
    m12 = outer + coupled * math.cos(s.elbow)
    m11 = inner + outer + 2.0 * coupled * math.cos(s.elbow)
    curved = coupled * math.sin(s.elbow)
    torque_1 += curved * (2.0 * w1 * w2 + w2 * w2)
    torque_2 -= curved * w1 * w1
    determinant = m11 * m22 - m12 * m12
    w1 += p.dt * (m22 * torque_1 - m12 * torque_2) / determinant
    w2 += p.dt * (m11 * torque_2 - m12 * torque_1) / determinant
    new = swing * w1 + bend * w2
    held = p.mass / p.dt if u.attached else 0.0  # the hand's own mass is part of what it shows
    return ManusState(
        s.shoulder + p.dt * w1, s.elbow + p.dt * w2, w1, w2, 0.0, 0.0, motor_1, motor_2, 0.0, 0.0,
        new.real, new.imag,
        force_x - held * (new.real - s.handle_vx), force_y - held * (new.imag - s.handle_vy),
    )  # fmt: skip


def torques(bars, s, shoulder_braked, elbow_braked):
    """On both joints by motors and brakes [Nm]."""
    return (
        s.shoulder_torque - bars.brake * shoulder_braked * s.shoulder_velocity,
        s.elbow_torque - bars.brake * elbow_braked * s.elbow_velocity,
    )


SERIAL_PLANT = PlanePlant("serial", Bars, rest, params, step, place, torques)
