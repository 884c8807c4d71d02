# SPDX-License-Identifier: Apache-2.0
"""The excitation of the locked rotor, one command per encoder sample; zero in case of a fault.

It replaces the controller during a torque trial. No ROS here.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from screw_module_ros.control.linearization import Linearization, torque_command
from screw_module_ros.control.modes import OFF
from screw_module_ros.geometry import torque_to_force
from screw_module_ros.safety.checks import EncoderLike, ForceLike, VerticalChecks, WatchSettings
from screw_module_ros.samples import sequence_gap

LARGEST_MOVE = 0.001
"""Limit of a locked rotor's motion [m at the nut], at which the torque goes off."""


class Sine(NamedTuple):
    """A sine of motor torque: amplitude [Nm], frequency [Hz], ticks it lasts, ticks a second.

    linearization: compensates the amplifier's dead zone, None = no compensation.
    """

    amplitude: float
    frequency: float
    ticks: int
    rate: float
    linearization: Linearization | None = None

    @property
    def peak(self) -> float:
        """Largest torque command [Nm]."""
        if self.linearization is None:
            return self.amplitude
        ends = (torque_command(self.linearization, s * self.amplitude) for s in (-1.0, 1.0))
        return max(map(abs, ends))

    def torque(self, tick: int) -> float:
        """Return the torque command [Nm] at a tick, counted from the start."""
        wanted = self.amplitude * math.sin(2.0 * math.pi * self.frequency * tick / self.rate)
        return torque_command(self.linearization, wanted) if self.linearization else wanted


class Output(NamedTuple):
    """Force command to the amplifier [N]."""

    force: float


class TorqueSource:
    """The controller of the vertical loop in a torque trial. All times are passed in [ns].

    fault: latched reason of zero force, empty without a fault. out: the last force [N]. answered:
    the newest used sample, None before the first. Another thread may call `begin`, `halt` and
    `clear`: each sets one reference, which the loop reads once per sample.
    """

    mode = OFF

    def __init__(self, watch: WatchSettings, period_ns: int):
        self.fault = ""
        self.out = 0.0
        self.answered: EncoderLike | None = None
        self._watch_settings, self._period_ns = watch, period_ns
        self._watch = VerticalChecks(watch, period_ns)
        self._sine: Sine | None = None
        self._begun: Callable[[int], None] = lambda tick: None
        self._first: tuple[Sine, int, float] | None = None  # sine, its first tick, height then

    def begin(self, sine: Sine, begun: Callable[[int], None]) -> None:
        """Start this sine with the next sample; `begun` gets that sample's number."""
        self._begun = begun
        self._sine = sine

    @property
    def busy(self) -> bool:
        """Whether a sine is running or about to start."""
        return self._sine is not None

    def halt(self) -> None:
        """Command zero from now on."""
        self._sine = None

    def clear(self) -> None:
        """Clear the latched fault and the watch; only with the torque off."""
        self._sine = self._first = None
        self._watch = VerticalChecks(self._watch_settings, self._period_ns)
        self.fault = ""

    def on_force(self, sample: ForceLike, now_ns: int) -> None:
        """Take a force sample."""
        self._watch.force(sample, now_ns)

    def on_encoder(self, sample: EncoderLike, now_ns: int) -> Output | None:
        """Return the force for a sample, None if the watch rejects the sample."""
        if not self._watch.encoder(sample, now_ns):
            return None
        self.answered = sample
        self.out = self._force_at(sample, now_ns)
        return Output(self.out)

    def idle(self, now_ns: int) -> Output | None:
        """Return a zero command if samples are missing while a force acts, else None."""
        if self.out == 0.0:
            return None
        self._doubt(self._watch.check(now_ns))
        if not self.fault and self._sine is not None:
            return None
        self.out = 0.0
        return Output(0.0)

    def count(self, now_ns: int) -> None:
        """Count nothing: `recording` has every sample and every command."""

    def end_tick(self, now_ns: int) -> None:
        """Expect nothing of the drive: the experiment asks it."""

    def _force_at(self, sample: EncoderLike, now_ns: int) -> float:
        sine = self._sine
        if sine is None:
            self._first = None
            return 0.0
        self._doubt(self._watch.check(now_ns))
        if self.fault:
            return 0.0
        if self._first is None or self._first[0] is not sine:
            self._first = (sine, sample.sequence, sample.position)
            self._begun(sample.sequence)
        _, first, height = self._first
        if abs(sample.position - height) > LARGEST_MOVE:
            moved = 1e3 * (sample.position - height)
            self._doubt(f"the nut has moved by {moved:.1f} mm: the rotor is not locked")
            return 0.0
        tick = 1 + sequence_gap(first, sample.sequence)
        if tick >= sine.ticks:
            self._sine = None
            return 0.0
        return torque_to_force(sine.torque(tick))

    def _doubt(self, reason: str | None) -> None:
        if reason and not self.fault:
            self.fault = reason
            self._sine = None
