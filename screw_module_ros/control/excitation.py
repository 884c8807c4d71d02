# SPDX-License-Identifier: Apache-2.0
"""The excitation of a trial: one sine of motor torque on the locked rotor (thesis 4.1).

The force of mode EXCITATION stands for a torque, converted with the nominal `SCREW` here and in the
amplifier (`torque_chain.excitation_chain`), so that no parameter `lead` changes the torque.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from ..geometry import force_to_torque, torque_to_force
from ..safety.checks import LARGEST_COMMAND
from ..samples import sequence_gap
from .linearization import Line, Linearization, torque_command

LARGEST_TORQUE = 0.42  # [Nm] thesis: continuous_torque
"""Largest amplitude: the continuous torque of the motor [Nm]."""
LARGEST_MOVE = 0.001
"""Limit of a locked rotor's motion, at which the torque goes off [m at the nut]."""


class Excitation(NamedTuple):
    """A sine of motor torque; without `ticks` none, and the lease alone counts.

    id: of the trial, another for each sine; amplitude [Nm]; frequency [Hz]; ticks: that it lasts;
    linearization: compensates the amplifier's dead zone, None = no compensation.
    """

    id: int = 0
    amplitude: float = 0.0
    frequency: float = 0.0
    ticks: int = 0
    linearization: Linearization | None = None

    @property
    def peak(self) -> float:
        """Largest torque command [Nm]."""
        ends = (-self.amplitude, self.amplitude)
        return max(abs(self._command(wanted)) for wanted in ends)

    def torque(self, tick: float, rate: float) -> float:
        """Return the torque command [Nm] at a tick since the start; rate: ticks a second [1/s]."""
        return self._command(
            self.amplitude * math.sin(2.0 * math.pi * self.frequency * tick / rate)
        )

    def _command(self, torque: float) -> float:
        return torque_command(self.linearization, torque) if self.linearization else torque

    def refusal(self, rate: float) -> str:
        """Return why this sine cannot be made at `rate` ticks a second [1/s], empty if it can."""
        if not 0.0 <= self.amplitude <= LARGEST_TORQUE:
            return (
                f"amplitude {self.amplitude:g} Nm exceeds the motor's continuous torque of "
                f"{LARGEST_TORQUE:g} Nm (thesis 3.1.6): choose a smaller one"
            )
        if not 0.0 <= self.frequency < 0.5 * rate:
            return (
                f"a sine of {self.frequency:g} Hz needs more than {rate:g} samples per second: "
                "start the graph with a higher rate, or ask for lower frequencies"
            )
        if self.linearization and (flaw := self.linearization.flaw()):
            return flaw
        if torque_to_force(self.peak) > LARGEST_COMMAND:
            return (
                f"a torque command of {self.peak:.3f} Nm: the amplifier accepts at most "
                f"{force_to_torque(LARGEST_COMMAND):.3f} Nm ({LARGEST_COMMAND:g} N)"
            )
        return ""


NOTHING = Excitation()


def as_numbers(linearization: Linearization) -> tuple[float, ...]:
    """Return the ten numbers of a map, as an ExcitationRequest has them."""
    joints, lower, middle, upper = linearization
    return (*joints, *lower, *middle, *upper)


def from_numbers(numbers: Sequence[float]) -> Linearization:
    """Return the map of ten numbers."""
    low, high, slope, offset, c3, c2, c1, c0, upper, shift = map(float, numbers)
    return Linearization(
        (low, high), Line(slope, offset), (c3, c2, c1, c0), Line(upper, shift)
    )


@dataclass(slots=True)
class Excited:
    """Memory of the step: id of the sine under way or spent; its first tick, None once it is over;
    height of the nut then [m]."""

    id: int = 0
    first: int | None = None
    height: float = 0.0


def excitation_step(
    wanted: Excitation, s: Excited, sequence: int, position: float, rate: float, active: bool
) -> tuple[float, str]:
    """Return the force for a torque [N] at a tick, and why it went off, empty if it did not.

    sequence: number of the tick; position: of the nut [m]; rate: ticks a second [1/s]; active:
    torque passes. A sine that was interrupted does not go on: it takes another id.
    """
    if not active:
        s.first = None
        return 0.0, ""
    if wanted.id != s.id:
        s.id, s.first, s.height = wanted.id, sequence, position
    if s.first is None:
        return 0.0, ""
    tick = 1 + sequence_gap(s.first, sequence)
    if tick >= wanted.ticks:
        s.first = None
        return 0.0, ""
    moved = position - s.height
    if not abs(moved) <= LARGEST_MOVE:
        s.first = None
        moved_mm = f"{1e3 * moved:.1f} mm"
        return 0.0, f"excitation: the nut has moved by {moved_mm}: the rotor is not locked"
    return torque_to_force(wanted.torque(tick, rate)), ""
