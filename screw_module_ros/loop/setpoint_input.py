# SPDX-License-Identifier: Apache-2.0
"""The newest set point of a game, as plain values."""

from __future__ import annotations

import math

MOVING_NS = 200_000_000
"""Age at which the velocity of a set point expires; its position stays valid."""


class SetpointInput:
    """The newest set point of some axes; NaN until one was given."""

    def __init__(self, axes: int):
        self._position = (math.nan,) * axes
        self._velocity = self._rest = (0.0,) * axes
        self._moved_ns = -MOVING_NS

    def ask(self, position: tuple[float, ...], velocity: tuple[float, ...], now_ns: int) -> None:
        """Set the set point: position [m], NaN = leave that axis alone, and velocity [m/s]."""
        self._position, self._velocity, self._moved_ns = position, velocity, now_ns

    def at(self, now_ns: int) -> tuple[float, ...]:
        """Return positions [m], then velocities [m/s], which are zero once they expired."""
        moving = now_ns - self._moved_ns <= MOVING_NS
        return (*self._position, *(self._velocity if moving else self._rest))
