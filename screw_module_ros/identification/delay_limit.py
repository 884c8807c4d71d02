# SPDX-License-Identifier: Apache-2.0
"""Resolution of a delay in sampled data (thesis 4.1.4, figs 4-13, 4-14)."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from .sampled_models import WIRE, fit_response, sampled_response


class Held(NamedTuple):
    """A sine through a hold, a wire with a delay and a sampler, as curves.

    time, sample_time [sample periods]; input, answer: input and output of the wire over `time`;
    samples: at `sample_time`; rebuilt: the samples held again, over `time`.
    """

    time: np.ndarray
    input: np.ndarray
    answer: np.ndarray
    sample_time: np.ndarray
    samples: np.ndarray
    rebuilt: np.ndarray


def held_wire(delay: float, periods: int = 20, per_period: int = 100) -> Held:
    """Return fig 4-13 (delay = 0) or 4-14; times and delay are in sample periods.

    periods: of one sine; per_period: points to draw.
    """
    time = np.arange(periods * per_period) / per_period
    first = time[::per_period]
    frequency = 1.0 / periods
    samples = _held(first - delay, frequency)
    return Held(
        time,
        _held(time, frequency),
        _held(time - delay, frequency),
        first,
        samples,
        np.repeat(samples, per_period),
    )


def _held(time: np.ndarray, frequency: float) -> np.ndarray:
    """Return a sine that begins at time 0, held from each whole number to the next."""
    return np.sin(2.0 * np.pi * frequency * np.maximum(np.floor(time), 0.0))


def misfit_profile(
    model: Callable[[np.ndarray], np.ndarray],
    measured: np.ndarray,
    delays: np.ndarray,
    start: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
) -> np.ndarray:
    """Return the least misfit for each delay [s], with all other parameters fitted.

    model: function of the other parameters and, last, the delay; start, low, high: initial values
    and bounds of the other parameters.
    """
    found = []
    for delay in delays:
        fit = fit_response(lambda x, d=delay: model(np.append(x, d)), measured, start, low, high)
        found.append(fit.misfit)
        start = np.clip(fit.values, 1.001 * low, 0.999 * high)
    return np.array(found)


def wire_profile(
    frequencies: np.ndarray, rate: float, delay: float, delays: np.ndarray
) -> np.ndarray:
    """Return the misfit of a wire with each of `delays` [s] to a wire with `delay`, both sampled.

    It is 0 for all delays with the same number of periods after rounding up.
    """
    truth = sampled_response(WIRE, frequencies, rate, delay)
    off = [sampled_response(WIRE, frequencies, rate, float(d)) / truth - 1.0 for d in delays]
    return np.sqrt(np.mean(np.abs(off) ** 2, axis=1))
