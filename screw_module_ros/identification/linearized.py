# SPDX-License-Identifier: Apache-2.0
"""A law as a linear system, by differences of its own step about a state in which it rests."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

STEP = 1e-7
"""Of a difference; one-sided: a negative mean square is no state of the guard."""
_NOTHING = 1e-9  # a smaller entry of a difference is rounding
_LEAST = 1e-3  # a gain below it is none

Linear = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""A, B, C, D of a sampled system."""


def linear_of(answers: np.ndarray, states: int) -> Linear:
    """Return the system of states that the inputs reach and an output depends on.

    answers: states and outputs after a step, a row each: without a change before it, then with each
    state and each input larger by `STEP`.
    """
    jacobian = ((answers[1:] - answers[0]) / STEP).T
    jacobian[np.abs(jacobian) < _NOTHING] = 0.0
    n = states
    a, b, c, d = jacobian[:n, :n], jacobian[:n, n:], jacobian[n:, :n], jacobian[n:, n:]
    used = _closure((c != 0.0).any(axis=0), a.T) & _closure((b != 0.0).any(axis=1), a)
    return a[np.ix_(used, used)], b[used], c[:, used], d


def largest_stable(stable: Callable[[float], bool], most: float) -> float:
    """Return the largest gain below the first unstable one, within 1 %; infinite up to `most`."""
    low = 0.0
    for gain in np.geomspace(0.05, most, 30):
        if not stable(float(gain)):
            high = float(gain)
            break
        low = float(gain)
    else:
        return math.inf
    while high - low > 0.01 * high:
        if high < _LEAST:
            return 0.0
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


def floats_in(dtype: np.dtype, begin: int = 0) -> np.ndarray:
    """Return the places of the floats in a record of `compiled.packed`, in steps of eight bytes."""
    found: list[int] = []
    for part, offset in ((field[0], field[1]) for field in (dtype.fields or {}).values()):
        if part.fields:
            found.extend(floats_in(part, begin + offset))
        elif part.base == np.float64:
            first = (begin + offset) // 8
            found.extend(range(first, first + part.itemsize // 8))
    return np.array(found)


def _closure(first: np.ndarray, onward: np.ndarray) -> np.ndarray:
    """Return what `first` (a mask) leads to; onward[i, j]: j acts on i."""
    found = first
    while (more := found | (onward[:, found] != 0.0).any(axis=1)).sum() > found.sum():
        found = more
    return found
