# SPDX-License-Identifier: Apache-2.0
"""Encoder and force sensor in the loop: request on the tick, reading within the period."""

from __future__ import annotations

from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

from ..clock import Clock
from ..devices.errors import DeviceError
from ..safety.timing import empty_histogram, note_latency
from ..samples import EncoderReading, ForceReading
from .ticker import Tick

if TYPE_CHECKING:  # each process with a loop would load it
    from ..devices.polled import Line

Reading = TypeVar("Reading", bound=EncoderReading | ForceReading, covariant=True)


class PolledDevice(Protocol[Reading]):
    """A driver that sends a request per tick and returns one reading for it."""

    def request(self, sequence: int, monotonic_ns: int, stamp_ns: int) -> None:
        """Send the request of this tick. Raises DeviceError."""

    def reading(self) -> Reading | None:
        """Return each reading once; None while there is none. Raises DeviceError."""


class PolledSensor(Generic[Reading]):
    """One sensor of the loop. The driver counts failures; the diagnostics show them.

    answers: histogram of the latencies from request to reading. skipped: ticks that an overrun
    skipped.
    """

    def __init__(self, device: PolledDevice[Reading], port: Line, clock: Clock):
        self.answers = empty_histogram()
        self.skipped = 0
        self._device, self._port, self._clock = device, port, clock

    def begin(self, tick: Tick) -> None:
        """Request the reading of this tick."""
        self.skipped += tick.skipped
        try:
            self._device.request(tick.sequence, tick.monotonic_ns, tick.stamp_ns)
        except DeviceError:
            return

    def answer(self, until_ns: int) -> Reading | None:
        """Return the requested reading, None if it has not come by `until_ns`."""
        try:
            while (reading := self._device.reading()) is None:
                if self._clock.now_ns() >= until_ns:
                    return None
                self._port.pump(until_ns)
        except DeviceError:
            return None
        note_latency(self.answers, self._clock.now_ns() - reading.monotonic_ns)
        return reading
