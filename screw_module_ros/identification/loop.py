# SPDX-License-Identifier: Apache-2.0
"""The vertical axis as one sampled loop in one function: what the in-process bench compiles.

One tick is one sample: encoder counts and quantised force in, the law or a sine, the scaling of the
drivers (force limits, I2t, linearization, per mille of the rated torque), and the plant's substeps,
of which the first still see the command of the tick before. The parts are the functions that the
nodes and the simulated rig run.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..control.friction import FrictionModel
from ..control.limits import TorqueLimits, clamp, limit_torque
from ..control.linearization import Linearization, torque_command
from ..control.vertical import VerticalInput as LawInput
from ..control.vertical import VerticalState as LawState
from ..control.vertical import vertical_step as law_step
from ..control.vertical_settings import VerticalSettings
from ..filters import LowpassCoefficients, LowpassState, back_difference, lowpass_step
from ..geometry import COUNTS_PER_TURN, Screw, counts_to_height, force_to_torque
from ..plant.amplifier import Amplifier, bridge_current
from ..plant.arm import HandPath, hand_point
from ..plant.current_sensor import CurrentSensorState, current_sensor_step
from ..plant.module import LOCKED_ROTOR, VerticalInput, VerticalParams, VerticalState
from ..plant.noise import normal_pair
from ..plant.transducer import RotorStep
from ..plant.vertical import vertical_step

REST, SINE, LAW = 0, 1, 2
COLUMNS = 6  # position, velocity, force, torque, command, current


class Transducer(NamedTuple):
    """Axes z of the transducer: noise of a sample, zero, where the zero drifts to [N], [Nm];
    drift_time [s]; counts per newton and newton metre."""

    force_noise: float
    torque_noise: float
    force_zero: float
    torque_zero: float
    force_drift: float
    torque_drift: float
    drift_time: float
    force_counts: float
    torque_counts: float


class Drive(NamedTuple):
    """Scaling on the way to the amplifier: rated torque [Nm], 6071 is per mille of it; amperes per
    newton metre; command limits [N]."""

    rated_torque: float
    amperes: float
    command_up: float
    command_down: float


class LoopParams(NamedTuple):
    """Everything that stays the same during a trial.

    period: of the samples [s]; steps: substeps in it; late: those before a command acts.
    kind: REST, SINE (amplitude [Nm], omega [rad/s]) or LAW; mode, centre [m]: of the law;
    linearized: the command goes through the linearization.
    """

    plant: VerticalParams
    amplifier: Amplifier
    sensor: RotorStep
    transducer: Transducer
    drive: Drive
    screw: Screw
    smooth: LowpassCoefficients
    law: VerticalSettings
    friction: FrictionModel
    linearization: Linearization
    limits: TorqueLimits
    path: HandPath
    period: float
    steps: int
    late: int
    kind: int
    mode: int
    linearized: bool
    amplitude: float
    omega: float
    centre: float
    fixture: int
    upright: float
    stage_speed: float
    stage_target: float


class LoopState(NamedTuple):
    """ticks: since the trial began; on_time: since power-on [s]; the module; the law; velocity
    filter; position of the last sample [m]; heat of the motor [Nm^2]; current wanted by the bridge
    [A]; volts: current sensor; first, second: state of the noise."""

    ticks: int
    on_time: float
    module: VerticalState
    law: LawState
    smoothed: LowpassState
    position: float
    heat: float
    current: float
    sensor: CurrentSensorState
    volts: float
    first: int
    second: int


def run_ticks(packed_params: Any, state: LoopState, columns: np.ndarray) -> LoopState:
    """Run one tick per row of `columns`, shape (n, COLUMNS), and fill it.

    packed_params: LoopParams from `compiled.packed`.
    """
    p = packed_params[0]
    for row in range(columns.shape[0]):
        state = tick(p, state, columns[row])
    return state


def tick(p: LoopParams, s: LoopState, row: np.ndarray) -> LoopState:
    """Take a sample, answer it, let one period pass."""
    module = s.module
    count = math.floor(module.nut / p.screw.lead * COUNTS_PER_TURN)
    position = counts_to_height(count, p.screw, COUNTS_PER_TURN)
    difference = back_difference(s.position, position, p.period)
    velocity, smoothed = lowpass_step(p.smooth, s.smoothed, difference)
    force, torque, first, second = _transduced(p, s)
    wanted, law = _answer(p, s, position, velocity, force)
    allowed, heat = limit_torque(p.limits, s.heat, wanted, p.period)
    command = allowed
    if p.linearized and allowed != 0.0:
        command = torque_command(p.linearization, allowed)
    command = round(command / p.drive.rated_torque * 1000.0) * p.drive.rated_torque * 0.001
    row[0], row[1], row[2], row[3], row[4] = position, velocity, force, torque, command
    row[5] = s.volts if p.fixture == LOCKED_ROTOR else module.current
    current = bridge_current(p.amplifier, command * p.drive.amperes)
    module, sensor, volts = _period(p, s, current)
    return LoopState(
        s.ticks + 1, s.on_time + p.period, module, law, smoothed, position, heat, current,
        sensor, volts, first, second,
    )  # fmt: skip


def _transduced(p: LoopParams, s: LoopState) -> tuple[float, float, int, int]:
    """Return force [N] and torque [Nm] about z as the ADC shows them, and the noise's next state.

    On the locked rotor the transducer sees the rotor's torque, else the patient's force.
    """
    t = p.transducer
    noise_1, noise_2, first, second = normal_pair(s.first, s.second)
    warm = 1.0 - math.exp(-s.on_time / t.drift_time)
    force = s.module.patient_force + t.force_zero + warm * t.force_drift + t.force_noise * noise_1
    torque = s.module.rotor_angle / p.plant.rotor.compliance
    torque += t.torque_zero + warm * t.torque_drift + t.torque_noise * noise_2
    return (
        round(force * t.force_counts) / t.force_counts,
        round(torque * t.torque_counts) / t.torque_counts,
        first,
        second,
    )


def _answer(
    p: LoopParams, s: LoopState, position: float, velocity: float, force: float
) -> tuple[float, LawState]:
    """Return the motor torque wanted [Nm] in answer to a sample, and the law's next state."""
    if p.kind == SINE:
        return p.amplitude * math.sin(p.omega * s.ticks * p.period), s.law
    if p.kind == REST:
        return 0.0, s.law
    inp = LawInput(p.mode, position, velocity, force, p.centre, 0.0, True)
    output, law = law_step(p.law, p.friction, s.law, inp, p.period)
    asked = clamp(output.force, -p.drive.command_down, p.drive.command_up)
    return force_to_torque(asked, p.screw), law


def _period(
    p: LoopParams, s: LoopState, current: float
) -> tuple[VerticalState, CurrentSensorState, float]:
    """Return the module and the current sensor [V] one period on; `current` acts after the delay.

    The hand moves along its path in a straight line within a period.
    """
    module, sensor, volts = s.module, s.sensor, s.volts
    dt = p.plant.dt
    hand, hand_velocity = hand_point(p.path, s.ticks * p.period)
    for step in range(p.steps):
        bridge = s.current if step < p.late else current
        module = vertical_step(
            p.plant,
            module,
            VerticalInput(
                bridge, True, False, p.fixture, False, p.upright, hand, hand_velocity,
                p.stage_speed, p.stage_target, 0.0,
            ),
        )  # fmt: skip
        hand += hand_velocity * dt
        if p.fixture == LOCKED_ROTOR:
            mean = module.torque / p.plant.torque_constant
            volts, sensor = current_sensor_step(p.sensor, sensor, mean)
    return module, sensor, volts
