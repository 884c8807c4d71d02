# SPDX-License-Identifier: Apache-2.0
"""Frequency responses: sines by least squares, and chains between D/A and A/D (appendix C).

The command is held over a sample period and passes, with a `delay`, through a chain of poles; the
chain's output is sampled. The response at w is the sum over all aliases v = w + n ws (thesis
eq 4.2): (1/Ts) sum over n of G(j v) exp(-j v delay) (1 - exp(-j v Ts)) / (j v).
`sampled_response` computes it in closed form. A stepped sine (`torque_sweep`) measures it.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from .lab import Lab, MissingResult, Part
from .results import Quantity, from_sources
from .static_torque import desired_torque
from .trials import Samples, TorqueTrial
from .uncertainty import Source, bounded

_WORST_CONDITION = 1e5  # condition of the fit: above it two parameters are not distinguishable
_POLE_KNOWN, _DELAY_KNOWN = 0.05, 0.2  # ours: as fig 4-6 is read, as amplifiers of a make differ
_APART = 1e-6  # poles closer than this, relatively, are moved apart
SETTLE_S = 0.05
"""Excluded start of each sine [s]: many time constants of the slowest pole, 221 Hz."""


class Response(NamedTuple):
    """A signal at one frequency, Re(value exp(j w t)), or the ratio of two.

    error: standard error of the real and of the imaginary part; it is also that of the magnitude
    and, divided by the magnitude, of the phase [rad].
    """

    value: complex
    error: float


class Chain(NamedTuple):
    """Poles in series: G(s) = gain x product of -p / (s - p); gain is that at zero frequency.

    poles [1/s], complex ones with their conjugates; none at all = a wire.
    """

    gain: float
    poles: tuple[complex, ...]


class Fit(NamedTuple):
    """values and their sources of uncertainty; misfit: root mean square of |model / measured - 1|.
    """

    values: np.ndarray
    scatter: list[Source]
    misfit: float

    def quantity(
        self, number: int, name: str, unit: str, text: str, *more: Source
    ) -> Quantity:
        """Return one of the values as a quantity; more: sources beside the scatter."""
        sources = (self.scatter[number], *more)
        return from_sources(name, float(self.values[number]), sources, unit, text)


WIRE = Chain(1.0, ())


def fit_sine(
    time: np.ndarray, values: np.ndarray, frequency: float, drift: bool = False
) -> Response:
    """Fit a sine with an offset to samples.

    time [s]; frequency [Hz]; drift: the offset may follow a straight line.
    Raises ValueError when the samples do not determine the sine.
    """
    time, values = np.asarray(time, float), np.asarray(values, float)
    if not np.all(np.isfinite(values)):
        raise ValueError("the samples are not all finite numbers")
    phase = 2.0 * math.pi * frequency * time
    terms = [np.cos(phase), np.sin(phase), np.ones_like(time)]
    if drift:
        terms.append((time - time.mean()) / max(float(np.ptp(time)), 1e-300))
    columns = np.column_stack(terms)
    normal = columns.T @ columns
    if len(time) <= len(terms) or np.linalg.cond(normal) > _WORST_CONDITION**2:
        raise ValueError(
            f"{len(time)} samples do not determine a sine of {frequency:g} Hz: record for longer"
        )
    inverse = np.linalg.inv(normal)
    found = inverse @ (columns.T @ values)
    left = values - columns @ found
    variance = float(left @ left) / (len(values) - len(found))
    errors = np.sqrt(variance * np.diag(inverse))
    error = float(math.hypot(errors[0], errors[1]) / math.sqrt(2.0))
    return Response(complex(found[0], -found[1]), error)


def response(
    time: np.ndarray,
    excitation: np.ndarray,
    answer: np.ndarray,
    frequency: float,
    drift: bool = False,
) -> Response:
    """Return output over input from samples of both at the same times; arguments as `fit_sine`.

    The input counts as exact: its deviation from a sine is not measurement noise. Raises ValueError
    without an input at that frequency.
    """
    source = fit_sine(time, excitation, frequency, drift).value
    found = fit_sine(time, answer, frequency, drift)
    if abs(source) <= 1e-9 * float(np.max(np.abs(excitation))) or source == 0.0:
        raise ValueError(f"the input has no sine of {frequency:g} Hz")
    return Response(found.value / source, found.error / abs(source))


def first_order(bandwidth: float) -> Chain:
    """Return a first-order low pass of a bandwidth [Hz] (eq C.1)."""
    return Chain(1.0, (complex(-2.0 * math.pi * bandwidth),))


def second_order(inertia: float, damping: float, stiffness: float) -> Chain:
    """Return K / (J s^2 + B s + K): torque at the transducer that locks the rotor.

    It corrects eq C.3, whose gain at rest is J (docs/contradictions.md).
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
    answer: np.ndarray = chain.gain * np.exp(-s * delay)
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
    hold = np.sinc(frequencies / rate) * np.exp(-1j * math.pi * frequencies / rate)
    return continuous_response(chain, frequencies, delay) * hold**2


Model = Callable[[np.ndarray], np.ndarray]
"""Parameters -> complex response."""


def model_of(
    kind: Callable[..., np.ndarray], chain: Callable[..., Chain], frequencies: np.ndarray,
    rate: float, known: float = 0.0,
) -> Model:  # fmt: skip
    """Return a response as a function of its gain, the numbers of its chain, and a delay [s].

    kind: `sampled_response` or `held_twice_response`; chain: of those numbers; frequencies [Hz];
    rate [1/s]; known: further delay [s].
    """

    def model(numbers: np.ndarray) -> np.ndarray:
        gain, *inner, delay = numbers
        return gain * kind(chain(*inner), frequencies, rate, known + delay)

    return model


def fit_response(
    model: Model,
    measured: np.ndarray,
    start: Sequence[float] | np.ndarray,
    low: Sequence[float] | np.ndarray,
    high: Sequence[float] | np.ndarray,
) -> Fit:
    """Fit a model's parameters to a measured response, with equal weights of the frequencies.

    start, low, high: initial values and bounds of the
    parameters. The standard errors come from the scatter of the measurement about the model, by a
    jackknife over the frequencies: noise is a larger share where the answer is small. Raises
    ValueError for too few frequencies.
    """
    count = len(start)
    spare = 2 * len(measured) - count
    if spare <= 0:
        raise ValueError(f"{len(measured)} frequencies do not determine {count} numbers")

    def relative(numbers: np.ndarray) -> np.ndarray:
        off = model(numbers) / measured - 1.0
        return np.concatenate([off.real, off.imag])

    size = np.abs(start)
    found = least_squares(
        relative, start, bounds=(low, high), x_scale=size, xtol=1e-12, ftol=1e-12
    )
    scatter = [
        Source("scatter of the frequencies about the model", unit * error, freedom)
        for unit, error, freedom in zip(
            size.tolist(), *_left_out(found.jac * size, found.fun), strict=True
        )  # alike in size: a good inverse
    ]
    return Fit(found.x, scatter, math.sqrt(2.0 * found.cost / len(measured)))


def _left_out(slopes: np.ndarray, residual: np.ndarray) -> tuple[list[float], list[float]]:
    """Return standard errors and their degrees of freedom, by one step for each frequency left out.

    slopes: of the residual over the parameters; both have real parts first, imaginary parts then.
    A few frequencies determine a parameter, such as the highest a delay: its degrees of freedom are
    theirs, by their weights (Satterthwaite; Bell and McCaffrey 2002).
    """
    n = len(residual) // 2
    inverse = np.linalg.pinv(slopes.T @ slopes)
    changes, weights = [], []
    for number in range(n):
        own = slopes[[number, n + number]]
        held = np.eye(2) - own @ inverse @ own.T
        changes.append(inverse @ own.T @ np.linalg.lstsq(held, residual[[number, n + number]])[0])
        weights.append(((inverse @ own.T) ** 2).sum(axis=1))
    off, weight = np.array(changes) - np.mean(changes, axis=0), np.array(weights)
    errors = np.sqrt((n - 1) / n * (off**2).sum(axis=0))
    return errors.tolist(), (weight.sum(axis=0) ** 2 / (weight**2).sum(axis=0)).tolist()


def _apart(poles: tuple[complex, ...]) -> tuple[complex, ...]:
    """Return the poles with equal ones slightly separated, as the partial fractions require."""
    kept: list[complex] = []
    for pole in poles:
        while any(abs(pole - other) < _APART * abs(pole) for other in kept):
            pole *= 1.0 + 2.0 * _APART
        kept.append(pole)
    return tuple(kept)


def whole_cycles(frequency: float, cycles: int, shortest: float) -> float:
    """Return the time of at least `cycles` whole cycles that last at least `shortest` [s]."""
    return max(cycles, math.ceil(shortest * frequency - 1e-9)) / frequency


def torque_sweep(
    frequencies: Iterable[float], trial: TorqueTrial, cycles: int, channel: str
) -> dict[str, TorqueTrial]:
    """Return a trial for each frequency [Hz], at the amplitude, linearization and rate of `trial`.

    channel: part of the trials' names.
    """
    rate = f"-{trial.rate:g}" if trial.rate else ""
    return {
        f"{channel}{rate}-{number:02d}": trial._replace(
            frequency=float(frequency),
            duration=SETTLE_S + whole_cycles(frequency, cycles, 1.0),
        )
        for number, frequency in enumerate(frequencies)
    }


def torque_part(trial: TorqueTrial, samples: Samples) -> Part:
    """Return the response of torque to desired torque."""
    commanded = desired_torque(trial.linearization, samples.command)
    return response_part(trial.frequency, samples.time, commanded, samples.torque, drift=True)


def current_part(trial: TorqueTrial, samples: Samples) -> Part:
    """Return the response of the current sensor to desired torque [V/Nm]."""
    return torque_part(trial, samples._replace(torque=samples.current))


def response_part(
    frequency: float, time: np.ndarray, excitation: np.ndarray, answer: np.ndarray,
    settle: float = SETTLE_S, drift: bool = False,
) -> Part:  # fmt: skip
    """Return the `response` after `settle` [s] as arrays."""
    kept = time >= settle
    found = response(time[kept], excitation[kept], answer[kept], frequency, drift)
    return {"value": np.array(found.value), "error": np.array(found.error)}


def sweep_of(parts: Mapping[str, Part]) -> tuple[np.ndarray, np.ndarray]:
    """Return the responses of a sweep and their standard errors, in the order of the trials."""
    return (
        np.array([part["value"] for part in parts.values()]),
        np.array([part["error"] for part in parts.values()]),
    )


class KnownAmplifier(NamedTuple):
    """Pole [Hz] and delay [s] of the amplifier, a note about their source, and what their errors
    make of a delay that is fitted beside them [s]."""

    pole: float
    delay: float
    note: str
    sources: tuple[Source, ...]


def known_amplifier(lab: Lab, pole: float, delay: float) -> KnownAmplifier:
    """Return the amplifier as measured in this lab, else with this pole [Hz] and delay [s]."""
    try:
        found = lab.result("amplifier_response")
    except MissingResult:
        return KnownAmplifier(
            pole, delay, f"Amplifier as in the settings: {pole:g} Hz, {1e6 * delay:g} us.",
            (bounded("pole of the amplifier, assumed within 5 %", _POLE_KNOWN / _turns(pole)),
             bounded("delay of the amplifier, assumed within 20 %", _DELAY_KNOWN * delay)),
        )  # fmt: skip
    measured = found.quantity("pole"), found.quantity("delay")
    pole, delay = (quantity.value for quantity in measured)
    pole_error, delay_error = (quantity.uncertainty for quantity in measured)
    return KnownAmplifier(
        pole, delay,
        f"Amplifier as measured by {found.experiment}: {pole:.4g} Hz, {1e6 * delay:.3g} us.",
        (Source("pole of the amplifier, as measured", pole_error / pole / _turns(pole)),
         Source("delay of the amplifier, as measured", delay_error)),
    )  # fmt: skip


def _turns(frequency: float) -> float:
    """Return a frequency [Hz] in rad/s; a share of the pole is a delay of that share over it."""
    return 2.0 * math.pi * frequency
