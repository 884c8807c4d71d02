# SPDX-License-Identifier: Apache-2.0
"""What the nodes that own CAN devices share: their bus, their clock, their device locks."""

from __future__ import annotations

import dataclasses
from typing import Annotated, NamedTuple

from screw_module_ros.control.timing import empty_histogram, note_latency
from screw_module_ros.devices.bus import BusSettings, open_port, where
from screw_module_ros.devices.bus_load import check_load
from screw_module_ros.devices.errors import DeviceError
from screw_module_ros.devices.port import Port
from screw_module_ros.settings import Setting

from .module_node import ModuleNode
from .realtime import Tick, Ticker
from .single import Lock, lock_device

_SLOW_POLL_S = 5.0


class RateSettings(NamedTuple):
    """The node ticks at whole multiples of one period of its clock."""

    rate: Annotated[float, Setting("ticks per second, one tick a period", "Hz", 50.0, 4000.0)] = (
        1000.0
    )


class DriverNode(ModuleNode):
    """A node with one CAN bus, ticking at its own rate.

    answers: histogram of the latencies from asking to the answer in hand, since the activation.
    """

    def __init__(self, name: str, port: int, rate: float = 1000.0):
        super().__init__(name)
        self.parameters.declare(BusSettings, "can", port=port)
        self.parameters.declare(RateSettings, rate=rate)
        self.port: Port | None = None
        self._device_locks: list[Lock] = []
        self._slow_timer = None
        self.bus_load = 0.0
        self.answers = empty_histogram()

    # For subclasses ------------------------------------------------------------------------

    def open_port(self, *devices: str) -> Port:
        """Open the bus and hold `devices` for this process; raises BusError, AlreadyRunning."""
        bus = self.parameters.read(BusSettings, "can")
        self.period_ns = period_of(self.parameters.read(RateSettings).rate)
        for device in devices:
            self._device_locks.append(
                lock_device(bus.interface, bus.channel, bus.port, device)
            )
        self.port = open_port(bus, self.clock)
        self.bus_name = where(bus)
        return self.port

    def check_bus_load(self, traffic: list) -> None:
        """Warn above 80 % of the bus, raise BusOverload above 100 % (design section 4)."""
        bus = self.parameters.read(BusSettings, "can")
        self.bus_load, warning = check_load(traffic, bus.bitrate, self.bus_name)
        if warning:
            self.get_logger().warning(warning)

    def start_clock(self) -> None:
        """Begin ticking; slow polls begin with it."""
        self.ticker = Ticker(self.clock, self.period_ns)
        self.skipped = 0
        self.answers = empty_histogram()
        self._slow_timer = self.periodic.every(self.clock, _SLOW_POLL_S, self.poll_slow)

    def stop_clock(self) -> None:
        """End the slow polls."""
        if self._slow_timer is not None:
            self.periodic.cancel(self._slow_timer)
            self._slow_timer = None

    def next_tick(self) -> Tick:
        """Sleep until the next tick and count what an overrun skipped."""
        tick = self.ticker.sleep()
        self.skipped += tick.skipped
        return tick

    def sample(self, device):
        """Sleep until the tick, ask `device` and return its reading, None when it does not come."""
        if not self.ask(device, self.next_tick()):
            return None
        return self.answer(device, self.ticker.due_ns())

    def ask(self, device, tick: Tick) -> bool:
        """Ask `device` for its reading of `tick`; return whether the bus took it."""
        try:
            device.request(tick.sequence, tick.monotonic_ns, tick.stamp_ns)
        except DeviceError:
            return False  # counted by the driver, shown by the diagnostics
        return True

    def answer(self, device, until_ns: int):
        """Return the reading asked for, None when it has not come by `until_ns`."""
        try:
            while (reading := device.reading()) is None:
                if self.clock.now_ns() >= until_ns:
                    return None
                self.port.pump(until_ns)
        except DeviceError:
            return None
        note_latency(self.answers, self.clock.now_ns() - reading.monotonic_ns)
        return reading

    def poll_slow(self) -> None:
        """Ask the device what changes slowly; in the executor's thread."""

    def close_port(self) -> None:
        """Close the bus and let the devices go."""
        self.stop_clock()
        if self.port is not None:
            self.port.close()
            self.port = None
        for lock in self._device_locks:
            lock.release()
        self._device_locks = []

    def port_values(self) -> dict:
        """Return the bus's part of the diagnostics."""
        counters = dataclasses.asdict(self.port.snapshot()) if self.port else {}
        values = {f"bus {name}": count for name, count in counters.items() if count}
        return {
            "bus": self.bus_name,
            "bus load [%]": f"{100 * self.bus_load:.0f}",
            "skipped ticks": self.skipped,
            **values,
        }


def period_of(rate: float) -> int:
    """Return the period of `rate` [Hz] in ns.

    Raises ValueError where it is no whole number of microseconds: ticks of nodes whose periods do
    not divide each other would never line up.
    """
    period_ns = round(1e9 / rate)
    if period_ns % 1000:
        raise ValueError(f"rate = {rate} Hz: its period must be a whole number of microseconds")
    return period_ns


def device_values(counters) -> dict:
    """Return a device's counters that are not zero, for diagnostics."""
    return {name: count for name, count in dataclasses.asdict(counters).items() if count}
