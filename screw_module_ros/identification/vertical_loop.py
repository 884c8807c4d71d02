# SPDX-License-Identifier: Apache-2.0
"""The vertical axis as one sampled loop, which the in-process stand compiles.

One tick is one sample: encoder counts and quantised force, the law or a sine, the amplifier's
torque chain, and the plant's substeps, in which earlier commands act until the delay has passed.
Nodes and simulated rig run the same functions.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..control.envelope import enveloped
from ..control.law import Law
from ..control.support import SupportInput, SupportSettings, support_step
from ..control.torque_chain import TorqueChain, commanded, commanded_torque, on_the_wire
from ..control.vertical import VerticalInput
from ..control.vertical_settings import VerticalSettings
from ..filters import LowpassCoefficients, VelocityState, velocity_step
from ..geometry import COUNTS_PER_TURN, counts_to_height
from ..plant.amplifier import Amplifier, bridge_current
from ..plant.instruments import CurrentSensorState, RotorStep, current_sensor_step
from ..plant.module import LOCKED_ROTOR, ModuleInput, ModuleState, VerticalParams
from ..plant.patient import HandPath, hand_point
from ..plant.sensor import normal_pair
from ..plant.vertical import vertical_step

REST, SINE, LAW = 0, 1, 2
SIDE_OMEGA = 2.0  # angular frequency of the sideways force [rad/s]
# position, velocity, force, torque, command, current; truth: handle, its velocity, patient's force;
# remaining share of the force gain, support in use
COLUMNS = 11


class Transducer(NamedTuple):
    """Axes z of the transducer: noise of a sample, zero, final drift of the zero [N], [Nm];
    drift_time: time constant of the drift [s]; counts per newton and newton metre."""

    force_noise: float
    torque_noise: float
    force_zero: float
    torque_zero: float
    force_drift: float
    torque_drift: float
    drift_time: float
    force_counts: float
    torque_counts: float


class LoopParams(NamedTuple):
    """Constant parameters of a trial.

    lead: of the screw that the encoder is on [m], which the laws need not know. chain: from force
    to torque command; amperes: command to the amplifier per newton metre [A/Nm].
    period: of the samples [s]; steps: substeps per period; late: substeps before a command acts,
    which may exceed a period. kind: REST, SINE (amplitude [Nm], omega [rad/s]) or LAW; mode: of the
    law; law: settings of its envelope, own: what its functions get; centre: where the trial begins,
    and the law's set point [m]. side_force: amplitude of the
    planar force on the handle [N]. counts: of the encoder per turn; volt_counts: of the A/D card
    that reads the current sensor [1/V]. support: of the patient's arm; wish: for it, up positive
    [N]; powered: the drive is enabled; braked: else it shorts the motor.
    """

    plant: VerticalParams
    lead: float
    amplifier: Amplifier
    sensor: RotorStep
    transducer: Transducer
    chain: TorqueChain
    amperes: float
    smooth: LowpassCoefficients
    law: VerticalSettings
    own: Any
    path: HandPath
    period: float
    steps: int
    late: int
    kind: int
    mode: int
    amplitude: float
    omega: float
    centre: float
    fixture: int
    upright: float
    stage_speed: float
    stage_target: float
    side_force: float = 0.0
    counts: int = COUNTS_PER_TURN
    volt_counts: float = 204.8
    support: SupportSettings = SupportSettings()
    wish: float = 0.0
    powered: bool = True
    braked: bool = False


class LoopState(NamedTuple):
    """ticks: since the trial began; on_time: since power-on [s]; the module; the law's
    `EnvelopeState` and the `SupportState`, from `compiled.packed`, which a tick changes in place;
    the encoder's last position and velocity filter; heat of the motor [Nm^2]; under_way: commanded
    currents of the bridge [A], first the acting one, then one for each whole period of delay;
    volts: current sensor; first, second: state of the noise."""

    ticks: int
    on_time: float
    module: ModuleState
    law: Any
    support: Any
    motion: VelocityState
    heat: float
    under_way: np.ndarray
    sensor: CurrentSensorState
    volts: float
    first: int
    second: int


class Reading(NamedTuple):
    """What one sample shows: position [m], velocity [m/s], force [N], torque [Nm]; motion: of the
    velocity's filter; first, second: state of the noise."""

    position: float
    velocity: float
    force: float
    torque: float
    motion: VelocityState
    first: int
    second: int


@functools.cache
def ticks_of(law: Law) -> Callable[[Any, LoopState, np.ndarray], LoopState]:
    """Return what runs one tick of a law per row of its last argument, shape (n, COLUMNS).

    Its first argument: LoopParams from `compiled.packed`. It fills the rows.
    """
    step = enveloped(law)

    def run_ticks(packed_params: Any, state: LoopState, columns: np.ndarray) -> LoopState:
        p = packed_params[0]
        for row in range(columns.shape[0]):
            shown = _sampled(p, state)
            if p.kind == LAW:
                hand = SupportInput(
                    p.wish, p.support.up, p.powered, shown.velocity, shown.force, 0.0
                )
                inp = VerticalInput(
                    p.mode, shown.position, shown.velocity, shown.force, p.centre, 0.0, p.powered,
                    0.0, 0.0, support_step(p.support, state.support[0], hand, p.period),
                )  # fmt: skip
                output = step(p.law, p.own, state.law[0], inp, p.period)
                made, heat = commanded(p.chain, state.heat, output.force, 1.0, p.period)
            else:
                made, heat = commanded_torque(p.chain, state.heat, _sine(p, state), p.period)
            state = _advanced(
                p, state, shown, on_the_wire(p.chain, made.command), heat, columns[row]
            )
        return state

    return run_ticks


def _sine(p: LoopParams, s: LoopState) -> float:
    """Return the torque of a trial without a law [Nm]."""
    return p.amplitude * math.sin(p.omega * s.ticks * p.period) if p.kind == SINE else 0.0


def _sampled(p: LoopParams, s: LoopState) -> Reading:
    """Return what encoder and transducer show."""
    count = math.floor(s.module.nut / p.lead * p.counts)
    position = counts_to_height(count, p.chain.screw, p.counts)
    velocity, motion = velocity_step(p.smooth, s.motion, position, p.period)
    force, torque, first, second = _transduced(p, s)
    return Reading(position, velocity, force, torque, motion, first, second)


def _advanced(
    p: LoopParams, s: LoopState, shown: Reading, command: float, heat: float, row: np.ndarray
) -> LoopState:
    """Fill the sample's row, and advance the plant by one period with a command to the drive."""
    module = s.module
    row[0], row[1], row[2], row[3], row[4] = (
        shown.position, shown.velocity, shown.force, shown.torque, command,
    )  # fmt: skip
    row[5] = module.current
    if p.fixture == LOCKED_ROTOR:
        row[5] = round(s.volts * p.volt_counts) / p.volt_counts
    row[6], row[7], row[8] = module.handle, module.handle_velocity, module.patient_force
    row[9], row[10] = s.law[0].guard.share, s.support[0].force
    under_way = np.empty(s.under_way.size + 1)
    under_way[:-1] = s.under_way
    under_way[-1] = bridge_current(p.amplifier, command * p.amperes)
    module, sensor, volts = _period(p, s, under_way[0], under_way[1])
    return LoopState(
        s.ticks + 1, s.on_time + p.period, module, s.law, s.support, shown.motion, heat,
        under_way[1:], sensor, volts, shown.first, shown.second,
    )  # fmt: skip


def _transduced(p: LoopParams, s: LoopState) -> tuple[float, float, int, int]:
    """Return force [N] and torque [Nm] about z as the ADC shows them, and the noise's next state.

    On the locked rotor the transducer sees the rotor's torque, else the patient's force.
    """
    t = p.transducer
    noise_1, noise_2, first, second = normal_pair(s.first, s.second)
    warm = 1.0 - math.exp(-s.on_time / t.drift_time)
    force = s.module.shown_force + t.force_zero + warm * t.force_drift + t.force_noise * noise_1
    torque = s.module.rotor_angle / p.plant.rotor.compliance
    torque += t.torque_zero + warm * t.torque_drift + t.torque_noise * noise_2
    return (
        round(force * t.force_counts) / t.force_counts,
        round(torque * t.torque_counts) / t.torque_counts,
        first,
        second,
    )


def _period(
    p: LoopParams, s: LoopState, before: float, after: float
) -> tuple[ModuleState, CurrentSensorState, float]:
    """Return the states of module and current sensor after one period, and the sensor's volts.

    before, after: currents of the bridge [A] before and after the arrival of a command. Within a
    period the hand moves at constant velocity.
    """
    module, sensor, volts = s.module, s.sensor, s.volts
    dt, arrives = p.plant.dt, p.late % p.steps
    hand, hand_velocity = hand_point(p.path, s.ticks * p.period)
    side_force = abs(p.side_force * math.sin(SIDE_OMEGA * s.ticks * p.period))
    for step in range(p.steps):
        bridge = before if step < arrives else after
        begun = module.current
        module = vertical_step(
            p.plant,
            module,
            ModuleInput(
                bridge, p.powered, p.braked, p.fixture, False, p.upright, hand, hand_velocity,
                p.stage_speed, p.stage_target, side_force, 0.0, 1.0,
            ),
        )  # fmt: skip
        hand += hand_velocity * dt
        if p.fixture == LOCKED_ROTOR:
            mean = module.torque / p.plant.torque_constant
            change = module.current - begun
            volts, sensor = current_sensor_step(p.sensor, sensor, mean, change)
    return module, sensor, volts
