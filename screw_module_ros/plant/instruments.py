# SPDX-License-Identifier: Apache-2.0
"""Instruments of the thesis's experiments: locked rotor, current sensor, signal analyser.

**The rotor locked to ground through the force transducer** (thesis 4.1.3, appendix C.3). The motor
is off the screw; J phi'' + B phi' + K phi = T, and the transducer reads K phi.

Damping: C.3 prints B = 7.2 Nm/(rad/s). With this value the mode is heavily overdamped (damping
ratio 8.1, a slow pole at K/B = 1389 rad/s, 221 Hz). That explains why magnitude and phase fall
below 200 Hz in fig 4-9; with light damping they would rise towards the folded resonance at 400 Hz.
So the printed value is the default; a small one shows the 3600 Hz mode.

The poles are too fast for the substep, so a substep with constant torque is solved exactly. The
rotor's own breakaway torque (5.44 mNm) is left out: over the microradians of a locked rotor its
bristles, soft compared with the transducer, carry no torque.

**The circuit that reads the motor current** for the A/D card (thesis 4.1.2, appendix C.2): 0.1 Ohm
shunt, differential amplifier, active low pass of second order (928.2 Hz), gain: 3.42 V/A. In
`H(s) = g w^2 / (s^2 + (R1 + R2) C1 w^2 s + w^2)` the symbols are those of C.2. It has the form of
an inertia on a damped spring, so the exact step of the rotor solves it.

**A dynamic signal analyser** on the servo amplifier alone (thesis 4.1.2: HP 3562A, 256 kHz). It
feeds a sine into the amplifier, held between its samples, and reads the current, without the
module. The amplifier is that of `amplifier.py` at the instrument's rate, where its delay lasts many
substeps.
"""

from __future__ import annotations

import cmath
import math
from typing import Annotated, NamedTuple

import numpy as np

from ..compiled import compiled
from ..settings import Setting
from .amplifier import Amplifier, bridge_current, delayed_step, discretised


class Transducer(NamedTuple):
    """Rotor and transducer of the locked-rotor fixture."""

    rotor_inertia: Annotated[float, Setting("motor rotor", "kg m^2", 1e-7, 1e-2)]
    stiffness: Annotated[float, Setting("transducer about z", "Nm/rad", 10.0, 1e6)]
    damping: Annotated[float, Setting("B of thesis C.3", "Nm s/rad", 0.0, 1e3)]


class RotorStep(NamedTuple):
    """Exact transition of angle and velocity over one substep of dt [s].

    compliance [rad/Nm]; lag: damping over stiffness [s], by which the angle follows a line of
    torque.
    """

    angle_angle: float
    angle_velocity: float
    velocity_angle: float
    velocity_velocity: float
    compliance: float
    lag: float
    dt: float


def rotor_step_settings(t: Transducer, dt: float) -> RotorStep:
    """Return the transition over dt [s] from the closed form of the matrix exponential."""
    square = t.stiffness / t.rotor_inertia
    half = 0.5 * t.damping / t.rotor_inertia
    root = cmath.sqrt(half * half - square)
    slow, fast = -half + root, -half - root
    if abs(root) < 1e-9 * half:  # critically damped: the limit of the formulas below
        slow += 1e-6 * half
        fast -= 1e-6 * half
    slow = square / fast  # avoids the cancellation in -half + root
    a, b = cmath.exp(slow * dt), cmath.exp(fast * dt)
    gap = slow - fast
    rise = ((a - b) / gap).real
    return RotorStep(
        angle_angle=((slow * b - fast * a) / gap).real,
        angle_velocity=rise,
        velocity_angle=-square * rise,
        velocity_velocity=((slow * a - fast * b) / gap).real,
        compliance=1.0 / t.stiffness,
        lag=t.damping / t.stiffness,
        dt=dt,
    )


def rotor_step(
    p: RotorStep, angle: float, velocity: float, mean: float, change: float
) -> tuple[float, float]:
    """Return angle [rad] and velocity [rad/s] after a substep of torque that follows a line.

    mean: over the substep [Nm]; change: from its beginning to its end [Nm]. With a constant torque
    a sweep would find a delay up to 0.15 us too short. The answer to a line is a line that lags.
    """
    slope = change * p.compliance / p.dt
    begin = (mean - 0.5 * change) * p.compliance - slope * p.lag
    offset, beyond = angle - begin, velocity - slope
    return (
        begin + slope * p.dt + p.angle_angle * offset + p.angle_velocity * beyond,
        slope + p.velocity_angle * offset + p.velocity_velocity * beyond,
    )


class Circuit(NamedTuple):
    """Parts of the circuit [Ohm], [F]."""

    shunt: float = 0.1  # [Ohm] thesis: current_sensor_Rs
    r1: float = 19_600.0  # [Ohm] thesis: current_sensor_R1
    r2: float = 20_000.0  # [Ohm] thesis: current_sensor_R2
    r3: float = 1_000.0  # [Ohm] thesis: current_sensor_R3
    r4: float = 33_200.0  # [Ohm] thesis: current_sensor_R4
    c1: float = 5.0e-9  # [F] thesis: current_sensor_C1
    c2: float = 1.5e-8  # [F] thesis: current_sensor_C2


PRINTED = Circuit()


class CurrentSensorState(NamedTuple):
    """Output [V] and its rate of change [V/s]."""

    volts: float = 0.0
    rate: float = 0.0


def current_sensor_params(dt: float, circuit: Circuit = PRINTED) -> RotorStep:
    """Return the circuit discretised for substeps of dt [s]: angle is volts, torque is current."""
    c = circuit
    gain = c.shunt * (1.0 + c.r4 / c.r3)
    inertia = c.r1 * c.r2 * c.c1 * c.c2 / gain
    damping = (c.r1 + c.r2) * c.c1 / gain
    return rotor_step_settings(Transducer(inertia, 1.0 / gain, damping), dt)


def current_sensor_step(
    p: RotorStep, state: CurrentSensorState, mean: float, change: float
) -> tuple[float, CurrentSensorState]:
    """Return the output [V] and the state after a substep of current that follows a line.

    mean: over the substep [A]; change: from its beginning to its end [A].
    """
    volts, rate = rotor_step(p, state.volts, state.rate, mean, change)
    return volts, CurrentSensorState(volts, rate)


def analyzed(
    amplifier: Amplifier, frequency: float, amplitude: float, duration: float, rate: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the result of `analyzer_sine`, from its compiled function."""
    return compiled(analyzer_sine)(amplifier, frequency, amplitude, duration, rate)


def analyzer_sine(
    amplifier: Amplifier, frequency: float, amplitude: float, duration: float, rate: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return command [A] and current [A] at the instants k / rate while a sine is played.

    frequency [Hz]; amplitude: of the command [A]; duration [s]; rate [1/s]. Sample k of the command
    is held from k / rate to (k + 1) / rate, the current is read as it begins. At rest before.
    """
    count = int(round(duration * rate))
    p = discretised(amplifier, 1.0 / rate)
    command = np.empty(count)
    settled = np.zeros(count + p.whole + 1)  # current of the bridge, after the delay
    answer = np.empty(count)
    current = 0.0
    for k in range(count):
        command[k] = amplitude * math.sin(2.0 * math.pi * frequency * k / rate)
        settled[k + p.whole + 1] = bridge_current(amplifier, command[k])
        answer[k] = current
        current, _ = delayed_step(p, current, settled[k], settled[k + 1])
    return command, answer
