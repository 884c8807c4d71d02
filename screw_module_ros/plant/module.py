# SPDX-License-Identifier: Apache-2.0
"""Records of the vertical module: parameters, inputs, state.

Two masses, thesis 5.1 and Table 5.1 (equation of motion 5.3, split at the play): the nut side is
everything the motor turns, as mass at the nut; the handle side is what moves up and down (10.04 N
of weight) with the transducer and the arm's mass. The third is ours: the screw, which its axial
support lets move along its axis. `vertical.vertical_step` moves them.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from ..settings import Setting
from .amplifier import Amplifier, AmplifierStep, amplifier_step_settings
from .friction import Friction
from .instruments import RotorStep, Transducer, rotor_step_settings
from .patient import RIGID, ArmForce

HUMAN_ARM, FREE, STAGE, LOCKED_ROTOR = 0, 1, 2, 3


class Vertical(NamedTuple):
    """Dimensions and masses of the vertical module."""

    lead: Annotated[float, Setting("screw lead", "m", 1e-4, 0.1)]
    turning_mass: Annotated[float, Setting("rotor, coupling, screw at the nut", "kg", 0.1, 50.0)]
    moving_mass: Annotated[float, Setting("parts that move up and down", "kg", 0.05, 20.0)]
    gravity: Annotated[float, Setting("standard gravity", "m/s^2", 0.0, 20.0)]
    play: Annotated[float, Setting("backlash between nut and handle", "m", 0.0, 5e-3)]
    contact_stiffness: Annotated[float, Setting("nut to handle", "N/m", 1e3, 1e8)]
    contact_damping: Annotated[float, Setting("nut to handle", "N s/m", 0.0, 1e5)]
    film_damping: Annotated[float, Setting("grease film across the play", "N s/m", 0.0, 1e4)]
    contact_depth: Annotated[float, Setting("where damping is full", "m", 1e-8, 1e-3)]
    rail_friction: Annotated[
        float, Setting("guide and cable on the handle's side of the play", "N", 0.0, 20.0)
    ]
    rail_stiffness: Annotated[float, Setting("bristles of that friction", "N/m", 1e3, 1e8)]
    support_stiffness: Annotated[
        float, Setting("axial, of the screw; rigid from 1e10 on", "N/m", 1e5, 1e12)
    ]
    support_damping_ratio: Annotated[
        float, Setting("of the screw on its axial support", "", 0.0, 2.0)
    ]
    screw_mass: Annotated[float, Setting("moving on the axial support", "kg", 0.01, 50.0)]
    travel: Annotated[float, Setting("between the end stops", "m", 0.05, 2.0)]
    stop_stiffness: Annotated[float, Setting("end stops", "N/m", 1e3, 1e7)]
    stop_damping: Annotated[float, Setting("end stops", "N s/m", 0.0, 1e5)]
    brake_damping: Annotated[float, Setting("shorted motor, Kt^2/R", "Nm s/rad", 0.0, 1.0)]
    stage_acceleration: Annotated[float, Setting("positioning stage", "m/s^2", 0.01, 100.0)]
    handle_offset: Annotated[float, Setting("handle from screw axis", "m", 0.0, 1.0)]
    grip_height: Annotated[float, Setting("hand above the transducer", "m", 0.0, 0.5)]


class VerticalParams(NamedTuple):
    """Everything `vertical_step` needs, for substeps of `dt` [s].

    turn_rate: 2 pi / lead [rad/m]; force_lag: time constant of the transducer's filter [s];
    hysteresis: half the width of the transducer's loop [N]; grip: of the hand, `RIGID` or soft.
    """

    module: Vertical
    friction: Friction
    amplifier: AmplifierStep
    rotor: RotorStep
    arm: ArmForce
    torque_constant: float
    turn_rate: float
    dt: float
    force_lag: float = 0.0
    hysteresis: float = 0.0
    grip: ArmForce = RIGID


class ModuleInput(NamedTuple):
    """Inputs of the module during a substep.

    current: from `bridge_current` [A]; powered: else the motor coasts; braked: unpowered and
    shorted; fixture: HUMAN_ARM, FREE, STAGE or LOCKED_ROTOR; locked: the pin holds the screw;
    upright: +1, upside down -1; hand, hand_velocity: virtual hand [m], [m/s]; stage_speed [m/s]
    and stage_target [m]; side_force: planar force at the handle [N]; load: what hangs on the handle
    beyond the arm's weight [N]; vigour: share of the arm's strength.
    """

    current: float
    powered: bool
    braked: bool
    fixture: int
    locked: bool
    upright: float
    hand: float
    hand_velocity: float
    stage_speed: float
    stage_target: float
    side_force: float
    load: float
    vigour: float


class ModuleState(NamedTuple):
    """State of the module.

    nut, handle [m] and velocities [m/s]; bristle: force it carries [N]; load: lagged moment on the
    bearing [Nm]; friction, patient_force, contact_force (of the handle on the nut) [N]; current [A]
    and the three commands before [A]; torque: on the rotor [Nm]; rotor_angle, rotor_velocity: of
    the rotor locked to the transducer [rad], [rad/s]; way: travelled by the nut since power-on [m];
    rail_bristle: force of the friction on the handle's side [N]; support [m], support_velocity: of
    the screw along its axis, as its support gives way; filtered_force: patient_force behind the
    transducer's filter, shown_force: behind its hysteresis too [N]; arm [m], arm_velocity: of an
    arm behind a soft grip.
    """

    nut: float
    nut_velocity: float
    handle: float
    handle_velocity: float
    bristle: float
    load: float
    friction: float
    patient_force: float
    contact_force: float
    current: float
    command_1: float
    command_2: float
    command_3: float
    torque: float
    rotor_angle: float
    rotor_velocity: float
    way: float
    rail_bristle: float
    support: float
    support_velocity: float
    filtered_force: float
    shown_force: float
    arm: float
    arm_velocity: float


def vertical_params(
    module: Vertical,
    friction: Friction,
    amplifier: Amplifier,
    transducer: Transducer,
    arm: ArmForce,
    dt: float,
    force_bandwidth: float = math.inf,
    hysteresis: float = 0.0,
    grip: ArmForce = RIGID,
) -> VerticalParams:
    """Return the parameters of `vertical_step` for substeps of dt [s].

    force_bandwidth: of the transducer's filter [Hz]; hysteresis: half the width of its loop [N];
    grip: of the hand. Raises ValueError when dt does not suit the amplifier's delay.
    """
    return VerticalParams(
        module,
        friction,
        amplifier_step_settings(amplifier, dt),
        rotor_step_settings(transducer, dt),
        arm,
        amplifier.torque_constant,
        2.0 * math.pi / module.lead,
        dt,
        1.0 / (2.0 * math.pi * force_bandwidth),
        hysteresis,
        grip,
    )


def resting_state(module: Vertical, position: float, upright: float) -> ModuleState:
    """Return the module at rest with the nut at `position` [m], the handle at the end of the play.

    Friction in its elastic range carries the weight, if possible. upright: +1, upside down -1.
    """
    weight = upright * module.moving_mass * module.gravity
    support = -weight / module.support_stiffness
    sag = 0.5 * module.play * upright + weight / module.contact_stiffness - support
    zeros = ModuleState(*(0.0,) * len(ModuleState._fields))
    return zeros._replace(
        nut=position,
        handle=position - sag,
        arm=position - sag,
        support=support,
        bristle=-weight,
        friction=-weight,
        contact_force=-weight,
    )
