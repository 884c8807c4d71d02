# SPDX-License-Identifier: Apache-2.0
"""The circuit that reads the motor current for the A/D card (thesis 4.1.2, appendix C.2).

0.1 Ohm shunt, differential amplifier, active low pass of second order (928.8 Hz), gain: 3.42 V/A.
In `H(s) = g w^2 / (s^2 + (R1 + R2) C1 w^2 s + w^2)` the symbols are those of C.2. It has the form
of an inertia on a damped spring, so the exact step of the rotor solves it.
"""

from __future__ import annotations

from typing import NamedTuple

from .transducer import RotorStep, Transducer, rotor_step, rotor_step_settings


class Circuit(NamedTuple):
    """Parts of the circuit [Ohm], [F]."""

    shunt: float = 0.1
    r1: float = 19_600.0
    r2: float = 20_000.0
    r3: float = 1_000.0
    r4: float = 33_200.0
    c1: float = 5.0e-9
    c2: float = 1.5e-8


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
    p: RotorStep, state: CurrentSensorState, current: float
) -> tuple[float, CurrentSensorState]:
    """Return the output [V] and the state after a substep of constant current [A]."""
    volts, rate = rotor_step(p, state.volts, state.rate, current)
    return volts, CurrentSensorState(volts, rate)
