# SPDX-License-Identifier: Apache-2.0
"""Magnitude and phase of a sine of known frequency, by least squares (thesis 4.1.2, 4.1.3)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

_WORST_CONDITION = 1e5  # of the fit: above it two parameters are not distinguishable


class Sine(NamedTuple):
    """Part of a signal at one frequency: Re(amplitude exp(j w t)).

    error: standard error of the real and of the imaginary part; offset: mean of the signal;
    residual: standard deviation of the residual. Units are the signal's.
    """

    amplitude: complex
    error: float
    offset: float
    residual: float


class Response(NamedTuple):
    """Output over input at one frequency.

    error: standard error of the real and of the imaginary part; it is also that of the magnitude
    and, divided by the magnitude, of the phase [rad].
    """

    value: complex
    error: float


def fit_sine(
    time: np.ndarray, values: np.ndarray, frequency: float, drift: bool = False
) -> Sine:
    """Fit a sine with an offset to samples.

    time [s]; frequency [Hz]; drift: the offset may follow a straight line.
    Raises ValueError when the samples do not determine the sine.
    """
    time, values = np.asarray(time, float), np.asarray(values, float)
    columns = _columns(time, values, frequency, drift)
    normal = columns.T @ columns
    if np.linalg.cond(normal) > _WORST_CONDITION**2:
        raise ValueError(_undetermined(frequency, len(time)))
    inverse = np.linalg.inv(normal)
    found = inverse @ (columns.T @ values)
    left = values - columns @ found
    variance = float(left @ left) / (len(values) - len(found))
    errors = np.sqrt(variance * np.diag(inverse))
    return Sine(
        complex(found[0], -found[1]),
        float(math.hypot(errors[0], errors[1]) / math.sqrt(2.0)),
        float(found[2]),
        math.sqrt(variance),
    )


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
    source = fit_sine(time, excitation, frequency, drift).amplitude
    found = fit_sine(time, answer, frequency, drift)
    if abs(source) <= 1e-9 * float(np.max(np.abs(excitation))) or source == 0.0:
        raise ValueError(f"the input has no sine of {frequency:g} Hz")
    return Response(found.amplitude / source, found.error / abs(source))


def _columns(
    time: np.ndarray, values: np.ndarray, frequency: float, drift: bool
) -> np.ndarray:
    """Return the unknowns' columns: cosine, sine, offset, drift."""
    if not frequency > 0.0:
        raise ValueError(f"a sine of {frequency:g} Hz cannot be fitted")
    if time.ndim != 1 or time.shape != values.shape:
        raise ValueError(f"times of shape {time.shape} for values of shape {values.shape}")
    if len(time) <= 3 + drift:
        raise ValueError(_undetermined(frequency, len(time)))
    if not np.all(np.isfinite(values)):
        raise ValueError("the samples are not all finite numbers")
    phase = 2.0 * math.pi * frequency * time
    columns = [np.cos(phase), np.sin(phase), np.ones_like(time)]
    if drift:
        columns.append((time - time.mean()) / max(float(np.ptp(time)), 1e-300))
    return np.column_stack(columns)


def _undetermined(frequency: float, count: int) -> str:
    return f"{count} samples do not determine a sine of {frequency:g} Hz: record for longer"
