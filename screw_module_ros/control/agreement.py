# SPDX-License-Identifier: Apache-2.0
"""Two measurements of one motion must agree: the encoder, and the position the drive reports.

A frozen or slipping encoder looks plausible by itself: the spring then pulls with a constant force
and no damping. The drive's own position (CiA 402 object 6064) has no home, so only the change of
the difference counts.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from ..settings import Setting

_SKEW = 0.04  # [s], age that the slower of the two may have: a state message at 100 Hz is 25 ms


class AgreementSettings(NamedTuple):
    """How far and how long the two may differ."""

    tolerance: Annotated[float, Setting("difference allowed at rest", "m", 1e-5, 0.1)] = 0.002
    duration: Annotated[float, Setting("how long more is tolerated", "s", 0.0, 10.0)] = 0.05


class Agreement:
    """Compares encoder and drive position; times are passed in."""

    def __init__(self, settings: AgreementSettings):
        """Start without a reference."""
        self._settings = settings
        self._offset: float | None = None
        self._apart_since_ns: int | None = None

    def restart(self) -> None:
        """Take the next pair as the new reference: after homing and after a restart of either."""
        self._offset = self._apart_since_ns = None

    def check(self, encoder: float, drive: float, velocity: float, now_ns: int) -> str | None:
        """Return why the two positions [m] disagree at now_ns [ns], or None.

        velocity: by the encoder [m/s]; the two measurements may be 40 ms apart. Values that are not
        finite disagree.
        """
        if self._offset is None:
            self._offset = encoder - drive
        difference = encoder - drive - self._offset
        if abs(difference) <= self._settings.tolerance + abs(velocity) * _SKEW:
            self._apart_since_ns = None
            return None
        if self._apart_since_ns is None:
            self._apart_since_ns = now_ns
        if now_ns - self._apart_since_ns < self._settings.duration * 1e9:
            return None
        return f"encoder and drive disagree by {difference * 1e3:.1f} mm"
