# SPDX-License-Identifier: Apache-2.0
"""The six-axis transducer between handle and hand (thesis 3.1.9): wrench, noise, bias, drift.

Axes are those of frame `handle`, parallel to `manus_base`; the wrench is that of the patient on the
robot. The hand holds the grip above the transducer, so a planar force gives a torque there. The
parasitic torque of the 77.85 mm between handle and nut (3.1.2; 77.8 mm for the transducer, 5.2.4)
loads the linear bearing, not the transducer: it enters friction, not this wrench. On the
locked-rotor fixture the transducer reads the rotor's torque about z.

Zeros drift as the electronics warm up: each axis approaches its own offset exponentially. The
simulated ATI electronics quantise the values. The filter before the converter acts only on the
force along z, which the force feedback uses; `plant.vertical` applies it.

The noise is normal random numbers as a pure function of two integers, the same compiled and plain:
two combined multiplicative generators (lecuyer1988), products below 2^63, then Box
and Muller. numba's and Python's generators would give compiled and plain function different noise.
"""

from __future__ import annotations

import math
import random
from typing import Annotated, NamedTuple

from ..settings import Setting

DRAWS = 6
"""Random numbers in one measured wrench, each of `uniform`."""
FORCE_COUNTS = 144.0
"""Of a newton [1/N] (thesis 3.1.9)."""

_MODULUS_1 = 2147483563
_MODULUS_2 = 2147483399
_TWO_PI = 2.0 * math.pi

Wrench = tuple[float, float, float, float, float, float]


def counted_force(force: float) -> float:
    """Return a force as the transducer's counts show it [N]."""
    return round(force * FORCE_COUNTS) / FORCE_COUNTS


class Sensor(NamedTuple):
    """Imperfections of the transducer; standard deviations."""

    force_noise: Annotated[float, Setting("of one sample", "N", 0.0, 10.0)]
    torque_noise: Annotated[float, Setting("of one sample", "Nm", 0.0, 1.0)]
    force_bias: Annotated[float, Setting("zero at the start", "N", 0.0, 100.0)]
    torque_bias: Annotated[float, Setting("zero at the start", "Nm", 0.0, 10.0)]
    force_drift: Annotated[float, Setting("zero, when warm", "N", 0.0, 100.0)]
    torque_drift: Annotated[float, Setting("zero, when warm", "Nm", 0.0, 10.0)]
    drift_time: Annotated[float, Setting("warm-up time constant", "s", 1.0, 1e5)]
    bandwidth: Annotated[float, Setting("first-order filter, force along z", "Hz", 10.0, 1e5)]
    hysteresis: Annotated[
        float, Setting("half the width of the loop, force along z", "N", 0.0, 10.0)
    ] = 0.0  # ours


class SensorParams(NamedTuple):
    """One transducer: noise [N], [Nm]; per axis zeros and drift [N, Nm]; time constant [s]."""

    force_noise: float
    torque_noise: float
    bias: Wrench
    drift: Wrench
    drift_time: float


def sensor_params(sensor: Sensor, seed: int) -> SensorParams:
    """Return the transducer that `seed` draws from these standard deviations."""
    draw = random.Random(f"transducer {seed}")

    def axes(force: float, torque: float) -> Wrench:
        spreads = force, force, force, torque, torque, torque
        fx, fy, fz, tx, ty, tz = (draw.gauss(0.0, spread) for spread in spreads)
        return fx, fy, fz, tx, ty, tz

    return SensorParams(
        sensor.force_noise,
        sensor.torque_noise,
        axes(sensor.force_bias, sensor.torque_bias),
        axes(sensor.force_drift, sensor.torque_drift),
        sensor.drift_time,
    )


def true_wrench(
    force_x: float, force_y: float, force_z: float, grip_height: float, rotor_torque: float
) -> Wrench:
    """Return force [N] and torque [Nm] at the transducer for a force at the grip above it [m]."""
    return (
        force_x,
        force_y,
        force_z,
        -grip_height * force_y,
        grip_height * force_x,
        rotor_torque,
    )


def measured_wrench(
    p: SensorParams, wrench: Wrench, time: float, first: int, second: int
) -> tuple[Wrench, int, int]:
    """Return the wrench with zeros, drift and noise, and the next state of the noise.

    time: since power-on [s]; first, second: state of the generator.
    """
    warm = 1.0 - math.exp(-time / p.drift_time)
    n1, n2, first, second = normal_pair(first, second)
    n3, n4, first, second = normal_pair(first, second)
    n5, n6, first, second = normal_pair(first, second)
    force = p.force_noise
    torque = p.torque_noise
    b = p.bias
    d = p.drift
    return (
        (
            wrench[0] + b[0] + warm * d[0] + force * n1,
            wrench[1] + b[1] + warm * d[1] + force * n2,
            wrench[2] + b[2] + warm * d[2] + force * n3,
            wrench[3] + b[3] + warm * d[3] + torque * n4,
            wrench[4] + b[4] + warm * d[4] + torque * n5,
            wrench[5] + b[5] + warm * d[5] + torque * n6,
        ),
        first,
        second,
    )


def seeded(seed: int) -> tuple[int, int]:
    """Return the generator's state for a seed >= 0; neighbouring seeds start far apart."""
    first = (seed * 2654435761 + 97531) % (_MODULUS_1 - 1) + 1
    second = (seed * 40503 + 8642097) % (_MODULUS_2 - 1) + 1
    for _ in range(5):
        _, first, second = uniform(first, second)
    return first, second


def advanced(first: int, second: int, draws: int) -> tuple[int, int]:
    """Return the state after so many calls of `uniform`; plain Python only."""
    return (
        first * pow(40014, draws, _MODULUS_1) % _MODULUS_1,
        second * pow(40692, draws, _MODULUS_2) % _MODULUS_2,
    )


def uniform(first: int, second: int) -> tuple[float, int, int]:
    """Return a number strictly between 0 and 1 and the next state."""
    first = first * 40014 % _MODULUS_1
    second = second * 40692 % _MODULUS_2
    drawn = first - second
    if drawn < 1:
        drawn += _MODULUS_1 - 1
    return drawn / _MODULUS_1, first, second


def normal_pair(first: int, second: int) -> tuple[float, float, int, int]:
    """Return two independent standard normal numbers and the next state."""
    radius, first, second = uniform(first, second)
    angle, first, second = uniform(first, second)
    length = math.sqrt(-2.0 * math.log(radius))
    angle *= _TWO_PI
    return length * math.cos(angle), length * math.sin(angle), first, second
