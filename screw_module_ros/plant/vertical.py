# SPDX-License-Identifier: Apache-2.0
"""The vertical screw module: motor and nut, play, handle, arm or stage, lock pin, end stops.

Motor, friction and encoder are on the nut's side; weight, end stops, transducer and arm are on the
handle's side. Between them is play with a film of grease, then a contact spring with a damper that
acts in contact only. The nut's force also pushes the screw along its axis, against its support; the
encoder, which turns with the screw, does not see that. One substep solves the three velocities
implicitly (backward Euler), so springs and friction can remove energy but not add any.

z is positive up the screw also when the module hangs upside down. `patient_force` is the force of
the patient (arm or stage) on the robot at the transducer, so it contains the reaction of the arm's
own mass, or of the hand's where a soft grip lies between the two; friction is positive where it
opposes upward motion (F_f in eq 5.3).
"""

from __future__ import annotations

import math

from .amplifier import amplifier_step
from .fixture import stage_velocity
from .friction import bristle_terms, passive_force, settled_bristle, steady_level
from .instruments import rotor_step
from .module import (
    HUMAN_ARM,
    LOCKED_ROTOR,
    STAGE,
    ModuleInput,
    ModuleState,
    Vertical,
    VerticalParams,
)
from .patient import spring_terms


def vertical_step(p: VerticalParams, s: ModuleState, u: ModuleInput) -> ModuleState:
    """Advance the module by one substep of p.dt."""
    if u.powered:
        current, mean = amplifier_step(
            p.amplifier, s.current, u.current, s.command_1, s.command_2, s.command_3
        )
        history_1, history_2, history_3 = u.current, s.command_1, s.command_2
    else:
        current, mean = amplifier_step(p.amplifier, s.current, 0.0, 0.0, 0.0, 0.0)
        history_1, history_2, history_3 = 0.0, 0.0, 0.0
    drive = p.torque_constant * mean
    if u.fixture == LOCKED_ROTOR:
        change = p.torque_constant * (current - s.current)
        angle, speed = rotor_step(p.rotor, s.rotor_angle, s.rotor_velocity, drive, change)
        return ModuleState(
            s.nut, 0.0, s.handle, 0.0, s.bristle, 0.0, s.friction, 0.0, s.contact_force,
            current, history_1, history_2, history_3, drive, angle, speed,
            s.way, s.rail_bristle, s.support, 0.0, 0.0, 0.0, s.arm, 0.0,
        )  # fmt: skip
    (
        nut, nut_velocity, handle, handle_velocity, bristle, friction, contact, patient, rail,
        support, support_velocity,
    ) = _move(p, s, u, drive)  # fmt: skip
    brake = p.module.brake_damping * p.turn_rate * nut_velocity if u.braked else 0.0
    moment = p.module.handle_offset * abs(patient) + p.module.grip_height * u.side_force
    load = s.load + (moment - s.load) * p.dt / (p.friction.load_time + p.dt)
    filtered = s.filtered_force + (patient - s.filtered_force) * p.dt / (p.force_lag + p.dt)
    shown = min(max(s.shown_force, filtered - p.hysteresis), filtered + p.hysteresis)
    arm, arm_velocity = _arm(p, s, u, handle, handle_velocity)
    return ModuleState(
        nut, nut_velocity, handle, handle_velocity, bristle, load, friction, patient, contact,
        current, history_1, history_2, history_3, drive - brake, 0.0, 0.0,
        s.way + abs(nut_velocity) * p.dt, rail, support, support_velocity, filtered, shown,
        arm, arm_velocity,
    )  # fmt: skip


def _arm(
    p: VerticalParams, s: ModuleState, u: ModuleInput, handle: float, handle_velocity: float
) -> tuple[float, float]:
    """Return position [m] and velocity of the arm, which a soft grip ties to the handle.

    Springs and dampers to the virtual hand and to the handle are implicit.
    """
    if p.grip.stiffness == 0.0 or u.fixture != HUMAN_ARM:
        return handle, handle_velocity
    stiffness, viscous, steady = spring_terms(
        p.arm, u.hand, u.hand_velocity, s.arm, s.arm_velocity, u.vigour, p.arm.extension
    )
    hanging = p.arm.weight + u.load
    steady += stiffness * (u.hand - s.arm) + viscous * u.hand_velocity - u.upright * hanging
    grip = p.grip.stiffness * (handle - s.arm) + p.grip.damping * handle_velocity
    push = p.arm.mass / p.dt * s.arm_velocity + steady + grip
    firm = viscous + p.grip.damping + (stiffness + p.grip.stiffness) * p.dt
    velocity = push / (p.arm.mass / p.dt + firm)
    return s.arm + p.dt * velocity, velocity


def _friction_level(p: VerticalParams, s: ModuleState, upright: float) -> float:
    """Return |friction| the bristle tends to at the present speed [N]."""
    f = p.friction
    against = s.nut_velocity * upright > 0.0
    level = steady_level(f, p.turn_rate, s.nut, abs(s.nut_velocity), against, s.way)
    weight = p.module.moving_mass * p.module.gravity
    mapped = p.module.handle_offset * passive_force(level, weight, against)
    # The map was measured at the handle: it includes the handle's friction, which does not act on
    # the nut.
    nut = level - p.module.rail_friction
    return max(nut + f.load_gain * (s.load - mapped), f.smallest)


def _stop_terms(m: Vertical, position: float, velocity: float, dt: float) -> tuple[float, float]:
    """Return (stiffness x depth [N], 1 where an end stop pushes) at the end of this substep."""
    ahead = position + dt * velocity
    depth = 0.0
    if ahead < 0.0:
        depth = -position
    elif ahead > m.travel:
        depth = m.travel - position
    else:
        return 0.0, 0.0
    push = m.stop_stiffness * (depth - dt * velocity) - m.stop_damping * velocity
    if push * (0.5 * m.travel - ahead) <= 0.0:  # a stop does not pull
        return 0.0, 0.0
    return m.stop_stiffness * depth, 1.0


def _move(
    p: VerticalParams, s: ModuleState, u: ModuleInput, drive: float
) -> tuple[float, float, float, float, float, float, float, float, float, float, float]:
    """Solve one substep of the three masses; drive: mean motor torque [Nm].

    Returns nut [m], its velocity, handle, its velocity, bristle, friction, contact, patient and the
    handle's own bristle [N], the screw's axial displacement [m] and its velocity.
    """
    m = p.module
    dt = p.dt
    level = _friction_level(p, s, u.upright)
    keep, slope, micro = bristle_terms(
        p.friction.stiffness, p.friction.damping, s.bristle, s.nut_velocity, level, dt
    )
    damping = slope + micro
    if u.braked:
        damping += m.brake_damping * p.turn_rate * p.turn_rate
    nut_gain = m.turning_mass / dt + damping
    nut_push = m.turning_mass / dt * s.nut_velocity + p.turn_rate * drive - keep * s.bristle

    weight = m.moving_mass * m.gravity
    mass = m.moving_mass
    stiffness, viscous, steady = 0.0, 0.0, 0.0
    held, hand, hand_velocity, hanging = p.arm, u.hand, u.hand_velocity, p.arm.weight + u.load
    if p.grip.stiffness > 0.0:  # the arm is the hand then; ahead, or its spring would damp both
        held, hand, hand_velocity = p.grip, s.arm + dt * s.arm_velocity, s.arm_velocity
        hanging = held.weight
    if u.fixture == HUMAN_ARM:
        mass += held.mass
        weight += hanging
        stiffness, viscous, steady = spring_terms(
            held, hand, hand_velocity, s.handle, s.handle_velocity, u.vigour, held.extension
        )
        steady += stiffness * (hand - s.handle) + viscous * hand_velocity
    stop, stopped = _stop_terms(m, s.handle, s.handle_velocity, dt)
    stop_gain = stopped * (m.stop_stiffness * dt + m.stop_damping)
    rail_keep, rail_slope, _ = bristle_terms(
        m.rail_stiffness, 0.0, s.rail_bristle, s.handle_velocity, max(m.rail_friction, 1e-9), dt
    )
    if m.rail_friction == 0.0:
        rail_keep, rail_slope = 0.0, 0.0
    own = -u.upright * weight + stop - rail_keep * s.rail_bristle
    stop_gain += rail_slope
    handle_gain = mass / dt + stiffness * dt + viscous + stop_gain
    handle_push = mass / dt * s.handle_velocity + own + steady
    stage = math.nan
    if u.fixture == STAGE:
        stage = stage_velocity(
            s.handle, s.handle_velocity, u.stage_speed, u.stage_target, m.stage_acceleration, dt
        )
        if (s.handle <= 0.0 and stage < 0.0) or (s.handle >= m.travel and stage > 0.0):
            stage = 0.0  # as the end switches of the stage do
    nut_velocity, handle_velocity, support_velocity, contact = _solve(
        m, s, dt, nut_gain, nut_push, handle_gain, handle_push, u.locked, stage
    )
    acceleration = (handle_velocity - s.handle_velocity) / dt
    if u.fixture == STAGE:
        patient = mass * acceleration + contact - own + stop_gain * handle_velocity
    elif u.fixture == HUMAN_ARM:
        patient = steady - (stiffness * dt + viscous) * handle_velocity
        patient -= held.mass * acceleration + u.upright * hanging
    else:
        patient = 0.0
    rail = settled_bristle(
        rail_keep * s.rail_bristle + rail_slope * handle_velocity, s.rail_bristle, m.rail_friction
    )
    bent = keep * s.bristle + slope * nut_velocity
    return (
        s.nut + dt * nut_velocity,
        nut_velocity,
        s.handle + dt * handle_velocity,
        handle_velocity,
        settled_bristle(bent, s.bristle, level),
        bent + micro * nut_velocity,
        contact,
        patient,
        rail,
        s.support + dt * support_velocity,
        support_velocity,
    )


def _solve(
    m: Vertical,
    s: ModuleState,
    dt: float,
    nut_gain: float,
    nut_push: float,
    handle_gain: float,
    handle_push: float,
    locked: bool,
    stage: float,
) -> tuple[float, float, float, float]:
    """Return the velocities of nut, handle and screw (along its axis) after the substep, and the
    contact force of the handle on the nut.

    Without contact, gain x velocity = push on each side [N]. A locked screw and a stage (velocity
    `stage`, NaN = none) prescribe their side's velocity. The screw is eliminated: its velocity is
    (push + contact force) / gain, so the contact acts as if softer by the share that the screw
    gives way. The direction of the masses decides whether the contact is assumed open or closed;
    the result is checked: a contact does not pull.
    """
    screw_gain, screw_push = _screw_terms(m, s, dt)
    sway = screw_push / screw_gain  # the screw's velocity without contact
    gap = s.handle - s.nut - s.support
    half = 0.5 * m.play
    ahead = gap + dt * (s.handle_velocity - s.nut_velocity - s.support_velocity)
    nut_velocity = 0.0
    handle_velocity = 0.0
    screw_velocity = 0.0
    contact = 0.0
    for _ in range(2):
        side = 1.0 if ahead > half else (-1.0 if ahead < -half else 0.0)
        depth = gap - side * half
        share = min(abs(depth) / m.contact_depth, 1.0)
        spring = m.contact_stiffness * depth * abs(side)
        firm = (m.contact_stiffness * dt + share * m.contact_damping) * abs(side)
        left = screw_gain / (screw_gain + firm + m.film_damping)
        gain = left * (firm + m.film_damping)
        steady = left * spring - gain * sway
        if locked:
            nut_velocity = 0.0
        elif stage == stage:
            nut_velocity = (nut_push + steady + gain * stage) / (nut_gain + gain)
        else:
            first = nut_push + steady
            second = handle_push - steady
            nut_velocity = (first * (handle_gain + gain) + second * gain) / (
                nut_gain * handle_gain + gain * (nut_gain + handle_gain)
            )
        if stage == stage:
            handle_velocity = stage
        else:
            handle_velocity = (handle_push - steady + gain * nut_velocity) / (handle_gain + gain)
        contact = steady + gain * (handle_velocity - nut_velocity)
        screw_velocity = (screw_push + contact) / screw_gain
        closing = handle_velocity - nut_velocity - screw_velocity
        pulls = side * (spring + firm * closing) < 0.0
        ahead = gap + dt * closing
        if side == 0.0 and abs(ahead) <= half:
            break
        if side != 0.0 and not pulls:
            break
        if pulls:
            ahead = 0.0
    return nut_velocity, handle_velocity, screw_velocity, contact


def _screw_terms(m: Vertical, s: ModuleState, dt: float) -> tuple[float, float]:
    """Return gain and push of the screw on its axial support: gain x velocity = push + contact.

    m x'' = F - k x - c x' with c = 2 zeta sqrt(k m); F: of the handle, through nut and thread.
    Spring and damper are implicit. The support is ours: assumed, not in the thesis.
    """
    damping = 2.0 * m.support_damping_ratio * math.sqrt(m.support_stiffness * m.screw_mass)
    gain = m.screw_mass / dt + damping + m.support_stiffness * dt
    return gain, m.screw_mass / dt * s.support_velocity - m.support_stiffness * s.support
