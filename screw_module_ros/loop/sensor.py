# SPDX-License-Identifier: Apache-2.0
"""Encoder and force sensor in the loop: asked on the tick, answered within the period."""

from __future__ import annotations

from typing import Generic, Protocol, TypeVar

from ..can_io.port import Port
from ..clock import Clock
from ..control.timing import empty_histogram, note_latency
from ..devices.errors import DeviceError
from .ticker import Tick

Reading = TypeVar("Reading")


class Asked(Protocol[Reading]):
    """A driver that is asked with the tick's number and time and gives one reading for it."""

    def request(self, sequence: int, monotonic_ns: int, stamp_ns: int) -> None:
        """Ask. Raises DeviceError."""

    def reading(self) -> Reading | None:
        """Return the answer, once; None while there is none. Raises DeviceError."""


class PolledSensor(Generic[Reading]):
    """One sensor of the loop. The driver counts what fails, the diagnostics show it.

    answers: histogram of the latencies from asking to the answer in hand. skipped: ticks that an
    overrun left out.
    """

    def __init__(self, device: Asked[Reading], port: Port, clock: Clock):
        self.answers = empty_histogram()
        self.skipped = 0
        self._device, self._port, self._clock = device, port, clock

    def ask(self, tick: Tick) -> None:
        """Ask for the reading of this tick."""
        self.skipped += tick.skipped
        try:
            self._device.request(tick.sequence, tick.monotonic_ns, tick.stamp_ns)
        except DeviceError:
            return

    def answer(self, until_ns: int) -> Reading | None:
        """Return the reading asked for, None when it has not come by `until_ns`."""
        try:
            while (reading := self._device.reading()) is None:
                if self._clock.now_ns() >= until_ns:
                    return None
                self._port.pump(until_ns)
        except DeviceError:
            return None
        note_latency(self.answers, self._clock.now_ns() - reading.monotonic_ns)
        return reading
