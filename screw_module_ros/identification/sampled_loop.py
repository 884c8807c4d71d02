# SPDX-License-Identifier: Apache-2.0
"""Stability of the vertical loop as a linear sampled system with contact (thesis 7.1).

Nut and handle are two masses in permanent contact, without play and friction. The environment, an
arm or a wall, is a mass, a spring and a damper at the handle. Amplifier pole and transducer filter
are continuous; sampling, hold and delay are exact. The loop is stable if the spectral radius is
below one. Friction stabilises and play destabilises the real loop, so the result is neither a lower
nor an upper bound of the real gain, but the limit of the linear loop.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from ..control.vertical_settings import CARRIED_HZ

_N, _H, _C, _F = 0, 2, 4, 5  # nut, handle, amplifier, transducer filter in the state
_STATES = 6


class Mechanism(NamedTuple):
    """nut_mass, handle_mass [kg]; contact_stiffness [N/m], contact_damping [Ns/m]; amplifier: its
    pole [Hz]; transducer: its filter [Hz]."""

    nut_mass: float = 4.4666
    handle_mass: float = 1.0234
    contact_stiffness: float = 20e6
    contact_damping: float = 3000.0
    amplifier: float = 1000.0
    transducer: float = 1000.0


class Environment(NamedTuple):
    """Load on the handle: mass [kg], stiffness [N/m], damping [Ns/m]."""

    mass: float = 3.0
    stiffness: float = 300.0
    damping: float = 5.0


class Sampling(NamedTuple):
    """rate [Hz]; delay: from a sample to the amplifier's answer, its pole not counted [s]."""

    rate: float = 1000.0
    delay: float = 1.26e-3


class Feedback(NamedTuple):
    """Force feedback of eq 6.6. gain; cutoff [Hz]; stiffness [N/m], damping [Ns/m] of the spring;
    velocity_cutoff [Hz]."""

    gain: float
    cutoff: float = 30.0
    stiffness: float = 100.0
    damping: float = 0.0
    velocity_cutoff: float = 30.0


class Observer(NamedTuple):
    """OBSERVER of `control.observer`. gain; cutoff [Hz]; bandwidth [rad/s]; mass [kg], delay [s]
    assumed by the observer; stiffness [N/m], damping [Ns/m]; inertia: share of the remaining mass
    that the law carries, without the reduction for a hand that does not hold firmly.
    """

    gain: float
    cutoff: float = 9.0
    bandwidth: float = 300.0
    mass: float = 5.5
    delay: float = 1.4e-3
    stiffness: float = 100.0
    damping: float = 5.0
    inertia: float = 0.0


def _radius(plant: tuple, sampling: Sampling, law: Feedback | Observer) -> float:
    step, before, after, outputs = plant
    if isinstance(law, Observer):
        a, b, c, d = _observer(law, 1.0 / sampling.rate)
    else:
        a, b, c, d = _feedback(law, 1.0 / sampling.rate)
    waiting = int(sampling.delay * sampling.rate * (1.0 + 1e-12)) + 1
    n, m = _STATES, len(a)
    size = n + m + waiting
    closed = np.zeros((size, size))
    command = np.zeros(size)
    command[:n] = d @ outputs
    command[n : n + m] = c
    # The first waiting command is the newest; the last two act within this period.
    closed[:n, :n] = step
    late = np.zeros(size)
    late[n + m + waiting - 1] = 1.0
    new = command if waiting == 1 else _unit(size, n + m + waiting - 2)
    closed[:n] += np.outer(before, late) + np.outer(after, new)
    closed[n : n + m, :n] = b @ outputs
    closed[n : n + m, n : n + m] = a
    closed[n + m] = command
    for k in range(1, waiting):
        closed[n + m + k, n + m + k - 1] = 1.0
    return float(np.abs(np.linalg.eigvals(closed)).max())


def sampled(
    mechanism: Mechanism, environment: Environment, sampling: Sampling
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return (A, B before, B after, C) over one period; outputs: nut's height [m], force [N].

    A command arrives a part of a period (the delay modulo the period) after a sample; B before and
    B after are the input matrices of the commands before and after the arrival.
    """
    dynamics, push = _continuous(mechanism, environment)
    period = 1.0 / sampling.rate
    part = math.fmod(sampling.delay, period)
    first, first_input = _held(dynamics, push, part)
    second, second_input = _held(dynamics, push, period - part)
    outputs = np.zeros((2, _STATES))
    outputs[0, _N] = 1.0
    outputs[1, _F] = 1.0
    return second @ first, second @ first_input, second_input, outputs


def _continuous(m: Mechanism, e: Environment) -> tuple[np.ndarray, np.ndarray]:
    """Return dynamics and input [per N of command] of nut, handle, amplifier and filter."""
    a = np.zeros((_STATES, _STATES))
    contact = np.zeros(_STATES)  # force of the handle on the nut
    contact[[_N, _N + 1]] = -m.contact_stiffness, -m.contact_damping
    contact[[_H, _H + 1]] = m.contact_stiffness, m.contact_damping
    held = np.zeros(_STATES)  # of spring and damper of the environment on the handle
    held[[_H, _H + 1]] = -e.stiffness, -e.damping
    a[_N, _N + 1] = a[_H, _H + 1] = 1.0
    a[_N + 1] = contact / m.nut_mass
    a[_N + 1, _C] += 1.0 / m.nut_mass
    a[_H + 1] = (held - contact) / (m.handle_mass + e.mass)
    pole = 2.0 * math.pi * m.amplifier
    a[_C, _C] = -pole
    lag = 2.0 * math.pi * m.transducer
    a[_F] = lag * (held - e.mass * a[_H + 1])
    a[_F, _F] -= lag
    push = np.zeros(_STATES)
    push[_C] = pole
    return a, push


def _held(a: np.ndarray, b: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Return transition matrix and input over a time [s] with a constant command."""
    n = len(a)
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[:n, n] = a, b
    found = expm(whole * time)
    return found[:n, :n], found[:n, n]


def _lowpass(cutoff: float, period: float) -> tuple[float, float]:
    warped = math.tan(math.pi * min(cutoff * period, 0.25))
    return warped / (1.0 + warped), (1.0 - warped) / (1.0 + warped)


def _feedback(law: Feedback, period: float):
    """Return (A, B, C, D) of force feedback; state: last force and its filter, last height, last
    difference and its filter; inputs: height, force."""
    gain, kept = _lowpass(law.cutoff, period)
    swift, slow = _lowpass(law.velocity_cutoff, period)
    a, b = np.zeros((5, 5)), np.zeros((5, 2))
    b[0, 1] = 1.0
    a[1, 1], a[1, 0], b[1, 1] = kept, gain, gain
    b[2, 0] = 1.0
    a[3, 2], b[3, 0] = -1.0 / period, 1.0 / period
    a[4, 4], a[4, 3] = slow, swift
    a[4] += swift * a[3]
    b[4] += swift * b[3]
    pull = -(1.0 + law.gain)
    c = law.gain * a[1] + pull * law.damping * a[4]
    d = law.gain * b[1] + pull * law.damping * b[4]
    d[0] += pull * law.stiffness
    return a, b, c, d


def _observer(law: Observer, period: float):
    """Return (A, B, C, D) of OBSERVER; state: position, velocity, disturbance, last force error and
    its filter, commands remembered, filter of the velocity."""
    pole = math.exp(-law.bandwidth * period)
    left = 1.0 - pole
    periods = law.delay / period
    whole = int(periods)
    part = periods - whole
    size = 5 + whole + 2 + 1
    acceleration = np.zeros(size)
    acceleration[2] = -1.0 / law.mass
    acceleration[5 + whole] += (1.0 - part) / law.mass
    acceleration[5 + whole + 1] += part / law.mass
    force = np.array([0.0, 1.0 / law.mass])
    ahead, ahead_in = 0.5 * period**2 * acceleration, 0.5 * period**2 * force
    ahead[0] += 1.0
    ahead[1] += period
    off, off_in = -ahead, np.array([1.0, 0.0]) - ahead_in
    a, b = np.zeros((size, size)), np.zeros((size, 2))
    a[0], b[0] = ahead + (1.0 - pole**3) * off, ahead_in + (1.0 - pole**3) * off_in
    swift = 1.5 * left**2 * (1.0 + pole) / period
    a[1], b[1] = period * acceleration + swift * off, period * force + swift * off_in
    a[1, 1] += 1.0
    hard = law.mass * left**3 / period**2
    a[2], b[2] = -hard * off, -hard * off_in
    a[2, 2] += 1.0
    pull, pull_in = -law.damping * a[1], -law.damping * b[1]
    pull_in[0] -= law.stiffness
    gain, kept = _lowpass(CARRIED_HZ, period)
    a[-1], b[-1] = gain * a[1], gain * b[1]
    a[-1, 1] += gain
    a[-1, -1] += kept
    carried = law.inertia * law.mass / (1.0 + law.gain) * 2.0 * math.pi * CARRIED_HZ
    pull, pull_in = pull + carried * (a[1] - a[-1]), pull_in + carried * (b[1] - b[-1])
    a[3], b[3] = pull, pull_in + np.array([0.0, 1.0])
    gain, kept = _lowpass(law.cutoff, period)
    a[4] = gain * a[3]
    a[4, 3] += gain
    a[4, 4] += kept
    b[4] = gain * b[3]
    c, d = pull + a[2] + law.gain * a[4], pull_in + b[2] + law.gain * b[4]
    a[5], b[5] = c, d
    for k in range(6, size - 1):
        a[k, k - 1] = 1.0
    return a, b, c, d


def _unit(size: int, index: int) -> np.ndarray:
    unit = np.zeros(size)
    unit[index] = 1.0
    return unit


def largest_gain(
    mechanism: Mechanism,
    environment: Environment,
    sampling: Sampling,
    law: Feedback | Observer,
    most: float = 100.0,
) -> float:
    """Return the largest gain with a stable loop, 0 without any.

    law: its gain is varied; most: largest gain of the search; the result is infinite if it is
    stable.
    """

    plant = sampled(mechanism, environment, sampling)

    def stable(gain: float) -> bool:
        return _radius(plant, sampling, law._replace(gain=gain)) < 1.0 + 1e-9

    low = 0.0
    for gain in np.geomspace(0.05, most, 30):
        if not stable(float(gain)):
            high = float(gain)
            break
        low = float(gain)
    else:
        return math.inf
    while high - low > 0.01 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low
