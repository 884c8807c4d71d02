# SPDX-License-Identifier: Apache-2.0
"""Position and velocity of one axis from its travel; homing is an offset kept here, on the host."""

from __future__ import annotations

from ..filters import VelocityState, lowpass_coefficients, velocity_settled, velocity_step


class Motion:
    """What one position sensor says: the nut's encoder [m] or a joint's drive [rad].

    position: above the mark once homed, else from wherever the sensor counts. velocity: back
    difference through the low-pass, 0 at the first sample. homed: the position is absolute.
    """

    __slots__ = ("_filter", "_offset", "_period_ns", "_state", "homed", "position", "velocity")

    def __init__(self, cutoff: float, period_ns: int):
        """Start with nothing seen: cutoff of the velocity's filter [Hz], period of samples [ns]."""
        self._filter = lowpass_coefficients(cutoff, period_ns * 1e-9)
        self._period_ns = period_ns
        self.restart()

    def restart(self) -> None:
        """Forget the last sample; the home position goes with it."""
        self._state: VelocityState | None = None
        self._offset = self.position = self.velocity = 0.0
        self.homed = False

    @property
    def seen(self) -> bool:
        """Whether there was a sample."""
        return self._state is not None

    def take(self, travel: float, elapsed_ns: int) -> None:
        """Take a sample: unwrapped travel [m or rad], time since the one before [ns]."""
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
        """Say that the axis stands at `position` [m or rad]; there must have been a sample."""
        self._offset = position - self._state.position
        self.position, self.homed = position, True
