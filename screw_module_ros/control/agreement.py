# SPDX-License-Identifier: Apache-2.0
"""Compares two measurements of one motion: the encoder, and the position that the drive reports.

A frozen or slipping encoder alone looks plausible, but the spring then pulls with a constant force
and without damping. The drive's position (CiA 402 object 6064) has no home, so the check uses only
the change of the difference. Each node converts counts to metres with its own `lead` and
`counts_per_turn`. If the two nodes describe different screws, the positions diverge in proportion
to the travel; the message then names these parameters.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from ..settings import Setting

_SKEW = 0.04  # [s] largest age of the slower one; a state message at 100 Hz is up to 25 ms old


class AgreementSettings(NamedTuple):
    """How far and how long the two may differ."""

    tolerance: Annotated[float, Setting("difference allowed at rest", "m", 1e-5, 0.1)] = 0.002
    duration: Annotated[float, Setting("how long more is tolerated", "s", 0.0, 10.0)] = 0.05


class Agreement:
    """Compares encoder and drive position; times are passed in."""

    def __init__(self, settings: AgreementSettings):
        """Start without a reference."""
        self._settings = settings
        self._reference: tuple[float, float] | None = None  # encoder and drive at the start [m]
        self._apart_since_ns: int | None = None

    def restart(self) -> None:
        """Take the next pair as the new reference; call it after homing and after a restart."""
        self._reference = self._apart_since_ns = None

    def check(self, encoder: float, drive: float, velocity: float, now_ns: int) -> str | None:
        """Return why the two positions [m] disagree at now_ns [ns], or None.

        velocity: from the encoder [m/s]. The two measurements may be 40 ms apart. Values that are
        not finite count as a disagreement.
        """
        if self._reference is None:
            self._reference = encoder, drive
        moved, drive_moved = encoder - self._reference[0], drive - self._reference[1]
        difference = moved - drive_moved
        if abs(difference) <= self._settings.tolerance + abs(velocity) * _SKEW:
            self._apart_since_ns = None
            return None
        if self._apart_since_ns is None:
            self._apart_since_ns = now_ns
        if now_ns - self._apart_since_ns < self._settings.duration * 1e9:
            return None
        return f"encoder and drive disagree by {difference * 1e3:.1f} mm" + self._cause(
            moved, drive_moved
        )

    def _cause(self, encoder: float, drive: float) -> str:
        """Return the parameter that explains why two real travels [m] differ."""
        least = self._settings.tolerance
        if abs(encoder) < least or abs(drive) < least:
            return ""
        if encoder * drive < 0.0:
            return "; they move opposite ways: compare `direction` of encoder and amplifier"
        return (
            f" after {encoder * 1e3:.1f} and {drive * 1e3:.1f} mm: compare `lead` and "
            "`counts_per_turn` of encoder and amplifier"
        )
