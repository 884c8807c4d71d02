# SPDX-License-Identifier: Apache-2.0
"""A law as a linear system, by differences of its own step about a state in which it rests."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ..filters import VelocityState, velocity_step

STEP = 1e-7
"""Of a difference; one-sided: a negative mean square is no state of the guard."""
_NOTHING = 1e-9  # a smaller entry of a difference is rounding
_LEAST = 1e-3  # a gain below it is none
_STABLE = 1.0 + 1e-7  # spectral radius; less is stable, but for what is computed

Linear = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""A, B, C, D of a sampled system."""


def filtered(smooth: Any, motion: np.ndarray, position: float, period: float) -> float:
    """Return the velocity that a filter shows of a position; motion: its state, which changes."""
    state = VelocityState(motion[0], motion[1], motion[2])
    velocity, state = velocity_step(smooth, state, position, period)
    motion[0], motion[1], motion[2] = state.position, state.raw, state.smooth
    return velocity


@functools.cache
def answers_of(tick: Callable[..., None], outputs: int) -> Callable[..., np.ndarray]:
    """Return what makes the answers of a law about a state in which it has settled.

    tick: carries out a tick of the law. It takes what is given, from `compiled.packed` where it is
    a record; the law's memory, the states of its velocity filters, shape (n, 3), and its inputs,
    which all may change; whether the law still settles; and where its outputs go, so many.
    """

    def answers(
        given: Any, memory: Any, flat: np.ndarray, places: np.ndarray, motions: np.ndarray,
        seen: np.ndarray, settle: int,
    ) -> np.ndarray:  # fmt: skip
        """Return states and outputs a tick after the law has settled, a row for each change.

        The first row is without one; then each state and each input is a step larger. flat, places:
        the memory as floats, and where its states are; settle: ticks.
        """
        inner, n = len(places), len(places) + motions.size
        found, made = np.empty((n + len(seen) + 1, n + outputs)), np.empty(outputs)
        kept, moved, now = flat.copy(), motions.copy(), seen.copy()
        for row in range(-1, len(found)):
            if row >= 0:
                flat[:], moved[:], now[:] = kept, motions, seen
            if 1 <= row <= inner:
                flat[places[row - 1]] += STEP
            elif inner < row <= n:
                moved[(row - 1 - inner) // 3, (row - 1 - inner) % 3] += STEP
            elif row > n:
                now[row - 1 - n] += STEP
            for _ in range(settle if row < 0 else 1):
                tick(given, memory, moved, now, row < 0, made)
            if row < 0:
                kept, motions, seen = flat.copy(), moved.copy(), now.copy()
            else:
                found[row, :inner], found[row, inner:n] = flat[places], moved.ravel()
                found[row, n:] = made
        return found

    return answers


def linear_of(answers: np.ndarray, states: int) -> Linear:
    """Return the system of states that the inputs reach and an output depends on.

    answers: of `answers_of`: without a change, then with each state and input larger by `STEP`.
    """
    jacobian = ((answers[1:] - answers[0]) / STEP).T
    jacobian[np.abs(jacobian) < _NOTHING] = 0.0
    n = states
    a, b, c, d = jacobian[:n, :n], jacobian[:n, n:], jacobian[n:, :n], jacobian[n:, n:]
    used = _closure((c != 0.0).any(axis=0), a.T) & _closure((b != 0.0).any(axis=1), a)
    return a[np.ix_(used, used)], b[used], c[:, used], d


def largest_stable(radius: Callable[[float], float], most: float) -> float:
    """Return the largest gain below the first unstable one, within 1 %; infinite up to `most`.

    radius: returns the spectral radius of the loop with a gain.
    """
    low = 0.0
    for gain in np.geomspace(0.05, most, 30):
        if not radius(float(gain)) < _STABLE:
            high = float(gain)
            break
        low = float(gain)
    else:
        return math.inf
    while high - low > 0.01 * high:
        if high < _LEAST:
            return 0.0
        middle = 0.5 * (low + high)
        low, high = (middle, high) if radius(middle) < _STABLE else (low, middle)
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
