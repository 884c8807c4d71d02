# SPDX-License-Identifier: Apache-2.0
"""Position and velocity of one axis: unwrapped counts, filtered differences, homing on the host."""

from __future__ import annotations

from ..filters import VelocityState, lowpass_coefficients, velocity_settled, velocity_step

FULL_RANGE = 1 << 32


class Unwrapper:
    """Continuous count from a position that wraps at `measuring_range` [counts].

    6004 of CiA 406 wraps at 6002, 6064 of CiA 402 at 2^32.

    The first sample is read as signed, so an encoder that powers up just below zero starts at a
    small negative count. A step is the shorter of the two directions: less than half a range.
    """

    __slots__ = ("_half", "_last", "_range", "count")

    def __init__(self, measuring_range: int):
        if not 2 <= measuring_range <= FULL_RANGE:
            raise ValueError(f"measuring_range = {measuring_range}: 2 to 2^32 counts are wanted")
        self._range = measuring_range
        self._half = (measuring_range + 1) // 2
        self._last = self.count = 0

    def holds(self, raw: int) -> bool:
        """Return whether the encoder can send this position at all."""
        return 0 <= raw < self._range

    def step(self, raw: int) -> int:
        """Return the continuous count [counts] for the next raw position."""
        delta = (raw - self._last) % self._range
        if delta >= self._half:
            delta -= self._range
        self._last = raw
        self.count += delta
        return self.count


class Motion:
    """Motion from one position sensor: the nut's encoder [m] or a joint's drive [rad].

    position: absolute once homed, else relative to the sensor's own zero. velocity: backward
    difference through the low-pass, 0 at the first sample. homed: the position is absolute.
    """

    __slots__ = ("_filter", "_offset", "_period_ns", "_state", "homed", "position", "velocity")

    def __init__(self, cutoff: float, period_ns: int):
        """Start without a sample: cutoff of the velocity filter [Hz], sample period [ns]."""
        self._filter = lowpass_coefficients(cutoff, period_ns * 1e-9)
        self._period_ns = period_ns
        self.restart()

    def restart(self) -> None:
        """Drop the last sample and the home position."""
        self._state: VelocityState | None = None
        self._offset = self.position = self.velocity = 0.0
        self.homed = False

    @property
    def seen(self) -> bool:
        """Whether there was a sample."""
        return self._state is not None

    def take(self, travel: float, elapsed_ns: int) -> None:
        """Process a sample: unwrapped travel [m or rad], time since the one before [ns]."""
        state = self._state
        if state is None or elapsed_ns <= 0:
            self.velocity, self._state = 0.0, velocity_settled(travel)
        else:
            periods = max(1, round(elapsed_ns / self._period_ns))
            self.velocity, self._state = velocity_step(
                self._filter, state, travel, elapsed_ns * 1e-9, periods
            )
        self.position = self._offset + travel

    def home(self, position: float) -> None:
        """Declare that the axis stands at `position` [m or rad]; requires a sample."""
        assert self._state is not None, "no sample yet"
        self._offset = position - self._state.position
        self.position, self.homed = position, True
