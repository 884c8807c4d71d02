# SPDX-License-Identifier: Apache-2.0
"""Plausibility of force commands at the amplifier.

The amplifier does not trust the controller. It accepts a command only when the command is new,
finite and within the range of this robot's controllers. `gate` checks the age of the command.
"""

from __future__ import annotations

from .stream import Stream


class CommandWatch:
    """Checks order, stamp and size of the force commands; all times are passed in."""

    def __init__(self, period_ns: int, largest_force: float):
        """Start without a command: period of the commands [ns], largest plausible force [N]."""
        self._stream = Stream("force command", period_ns)
        self._largest = largest_force
        self._fault = ""

    @property
    def fault(self) -> str:
        """Return the latched reason, empty when nothing is latched."""
        return self._fault

    @property
    def newest_ns(self) -> int:
        """Return the acquisition time [ns] behind the newest command; 0 = none yet."""
        return self._stream.monotonic_ns if self._stream.seen else 0

    def accept(self, sequence: int, monotonic_ns: int, force: float, now_ns: int) -> bool:
        """Return whether to accept the command received at now_ns [ns], force [N]."""
        newer = self._stream.accept(sequence, monotonic_ns, now_ns)
        self._fault = self._fault or self._stream.fault  # also of one that is newer
        if not newer:
            return False
        if not abs(force) <= self._largest:
            self._fault = self._fault or (
                f"force command: {force:g} N, beyond anything a controller may ask"
            )
            return False
        return True

    def reset(self) -> None:
        """Forget the latched fault."""
        self._fault = ""
        self._stream.reset()
