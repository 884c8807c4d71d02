# SPDX-License-Identifier: Apache-2.0
"""Frequency response of a continuous chain between a D/A and an A/D converter (thesis appendix C).

The command is held over a sample period and passes, with a `delay`, through a chain of poles; the
chain's output is sampled. The response at w is the sum over all aliases v = w + n ws (thesis
eq 4.2): (1/Ts) sum over n of G(j v) exp(-j v delay) (1 - exp(-j v Ts)) / (j v).
`sampled_response` computes it in closed form.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

_APART = 1e-6  # poles closer than this, relatively, are moved apart


class Chain(NamedTuple):
    """Poles in series: G(s) = gain x product of -p / (s - p); gain is that at zero frequency.

    poles [1/s], complex ones with their conjugates; none at all = a wire.
    """

    gain: float
    poles: tuple[complex, ...]


class Fit(NamedTuple):
    """values and their standard errors; misfit: root mean square of |model / measured - 1|."""

    values: np.ndarray
    errors: np.ndarray
    misfit: float


WIRE = Chain(1.0, ())


def first_order(bandwidth: float) -> Chain:
    """Return a first-order low pass of a bandwidth [Hz] (C.1)."""
    return Chain(1.0, (complex(-2.0 * math.pi * bandwidth),))


def second_order(inertia: float, damping: float, stiffness: float) -> Chain:
    """Return K / (J s^2 + B s + K) (C.3): torque at the transducer that locks the rotor.

    inertia J [kg m^2], damping B [Nm s/rad], stiffness K [Nm/rad].
    """
    half, square = 0.5 * damping / inertia, stiffness / inertia
    fast = -half - cmath.sqrt(half * half - square)
    return Chain(1.0, (square / fast, fast))


def current_sensor() -> Chain:
    """Return the current sensor's circuit of C.2, volts per ampere."""
    gain = 0.1 * (1.0 + 33_200.0 / 1_000.0)
    square = 1.0 / (19_600.0 * 20_000.0 * 5e-9 * 1.5e-8)
    return second_order(1.0, (19_600.0 + 20_000.0) * 5e-9 * square, square)._replace(gain=gain)


def series(*chains: Chain) -> Chain:
    """Return chains one after the other."""
    return Chain(
        math.prod(chain.gain for chain in chains), sum((chain.poles for chain in chains), ())
    )


def continuous_response(chain: Chain, frequencies: np.ndarray, delay: float = 0.0) -> np.ndarray:
    """Return G(jw) exp(-jw delay) at frequencies [Hz]; delay [s]."""
    s = 2j * math.pi * np.asarray(frequencies, float)
    answer = chain.gain * np.exp(-s * delay)
    for pole in chain.poles:
        answer = answer * (-pole / (s - pole))
    return answer


def sampled_response(
    chain: Chain, frequencies: np.ndarray, rate: float, delay: float
) -> np.ndarray:
    """Return the exact response between held commands and samples, frequencies [Hz].

    rate: samples per second [1/s]; delay: from a sample to its command, plus the delay of the chain
    [s]. Sample k is taken just before a command without delay acts. Raises ValueError for a
    negative delay.
    """
    if not delay >= 0.0:
        raise ValueError(f"delay = {delay!r} s: zero or more is wanted")
    period = 1.0 / rate
    z = np.exp(2j * math.pi * np.asarray(frequencies, float) * period)
    if not chain.poles:
        return chain.gain * z ** -math.ceil(delay / period * (1.0 - 1e-12))
    whole = math.floor(delay / period * (1.0 + 1e-12))
    early = max(delay - whole * period, 0.0)  # of a period, before the delayed command changes
    late = period - early
    poles = _apart(chain.poles)
    answer = np.zeros_like(z)
    for number, pole in enumerate(poles):
        others = poles[:number] + poles[number + 1 :]
        share = -pole * math.prod(-other / (pole - other) for other in others)
        newer = np.expm1(pole * late) / pole
        older = cmath.exp(pole * late) * np.expm1(pole * early) / pole
        answer += share * (newer + older / z) / (z - cmath.exp(pole * period))
    return chain.gain * answer / z**whole


def held_twice_response(
    chain: Chain, frequencies: np.ndarray, rate: float, delay: float
) -> np.ndarray:
    """Return the response of the thesis's block diagram as drawn (fig C-1), without aliasing.

    It has a hold for the D/A and another for the A/D: half a period more lag than in the samples.
    """
    frequencies = np.asarray(frequencies, float)
    return continuous_response(chain, frequencies, delay) * _hold(frequencies, rate) ** 2


def fit_response(
    model: Callable[[np.ndarray], np.ndarray],
    measured: np.ndarray,
    start: Sequence[float],
    low: Sequence[float],
    high: Sequence[float],
) -> Fit:
    """Fit a model's parameters to a measured response, with equal weights of the frequencies.

    model: parameters -> complex response; start, low, high: initial values and bounds of the
    parameters. The standard errors come from the scatter of the measurement about the model. Raises
    ValueError for too few frequencies.
    """
    count = len(start)
    unknowns = 2 * len(measured) - count
    if unknowns <= 0:
        raise ValueError(f"{len(measured)} frequencies do not determine {count} numbers")

    def relative(numbers: np.ndarray) -> np.ndarray:
        off = model(numbers) / measured - 1.0
        return np.concatenate([off.real, off.imag])

    size = np.abs(start)
    found = least_squares(
        relative, start, bounds=(low, high), x_scale=size, xtol=1e-12, ftol=1e-12
    )
    square = 2.0 * found.cost
    slopes = found.jac * size  # alike in size, so that the inverse is a good one
    covariance = np.linalg.pinv(slopes.T @ slopes) * square / unknowns
    errors = size * np.sqrt(np.diag(covariance))
    return Fit(found.x, errors, math.sqrt(square / len(measured)))


def _hold(frequencies: np.ndarray, rate: float) -> np.ndarray:
    """Return the zero-order hold (1 - exp(-j w T)) / (j w T) at frequencies [Hz]."""
    return np.sinc(frequencies / rate) * np.exp(-1j * math.pi * frequencies / rate)


def _apart(poles: tuple[complex, ...]) -> tuple[complex, ...]:
    """Return the poles with equal ones slightly separated, as the partial fractions require."""
    kept: list[complex] = []
    for pole in poles:
        while any(abs(pole - other) < _APART * abs(pole) for other in kept):
            pole *= 1.0 + 2.0 * _APART
        kept.append(pole)
    return tuple(kept)
