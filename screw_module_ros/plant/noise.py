# SPDX-License-Identifier: Apache-2.0
"""Normal random numbers as a pure function of two integers, the same compiled and plain.

Two combined multiplicative generators (L'Ecuyer, Comm. ACM 31, 1988), products below 2^63, then
Box and Muller. numba's and Python's generators would give compiled and plain function different
noise.
"""

from __future__ import annotations

import math

_MODULUS_1 = 2147483563
_MODULUS_2 = 2147483399
_TWO_PI = 2.0 * math.pi


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
