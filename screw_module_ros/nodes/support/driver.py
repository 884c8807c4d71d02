# SPDX-License-Identifier: Apache-2.0
"""Base of the nodes with CAN devices: bus, device locks, slow polls."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Annotated, NamedTuple

from screw_module_ros import graph
from screw_module_ros.can_io.bus import BusSettings, open_port, where
from screw_module_ros.can_io.load import check_load
from screw_module_ros.can_io.port import Port
from screw_module_ros.loop.ticker import period_of
from screw_module_ros.settings import Setting

from .module_node import ModuleNode
from .single import Lock, lock_device
from .timers import Timer, Watch

_SLOW_POLL_S = 5.0


class RateSettings(NamedTuple):
    """The node ticks at whole multiples of one period of its clock."""

    rate: Annotated[float, Setting("ticks per second, one tick a period", "Hz", 50.0, 4000.0)] = (
        1000.0
    )


class DriverNode(ModuleNode):
    """A node with one CAN bus and its own tick rate."""

    def __init__(self, name: str, rate: float = 1000.0):
        super().__init__(name)
        self.parameters.declare(BusSettings, "can", port=graph.port_of(name))
        self.parameters.declare(RateSettings, rate=rate)
        self.port: Port | None = None
        self._device_locks: list[Lock] = []
        self._polls: list[Timer | Watch] = []
        self._reported = ""
        self.bus_load = 0.0

    # For subclasses ------------------------------------------------------------------------

    def open_port(self, *devices: str) -> Port:
        """Open the bus and lock `devices` for this process; raises BusError, AlreadyRunning."""
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
        """Warn above 80 % of the bus, raise BusOverload above 100 % (`can_io/load.py`)."""
        bus = self.parameters.read(BusSettings, "can")
        self.bus_load, warning = check_load(traffic, bus.bitrate, self.bus_name)
        if warning:
            self.get_logger().warning(warning)

    def start_polls(self, fault: Callable[[], str] | None = None) -> None:
        """Begin the slow polls.

        fault: returns the device's latched fault, for a node without a state message. /diagnostics
        shows a change of it at once: the supervisor must not permit motion meanwhile.
        """
        self._polls = [self.periodic.every(self.clock, _SLOW_POLL_S, self.poll_slow)]
        if fault is not None:
            self._reported = fault()
            changed = self.periodic.when(
                self.clock, lambda: fault() != self._reported, lambda: self._report(fault())
            )
            self._polls.append(changed)

    def _report(self, fault: str) -> None:
        self._reported = fault
        self.publish_health()

    def stop_polls(self) -> None:
        """End the slow polls."""
        for timer in self._polls:
            self.periodic.cancel(timer)
        self._polls = []

    def poll_slow(self) -> None:
        """Read the device's slow values; in the executor's thread."""

    def close_port(self) -> None:
        """Close the bus and release the device locks."""
        self.stop_polls()
        if self.port is not None:
            self.port.close()
            self.port = None
        for lock in self._device_locks:
            lock.release()
        self._device_locks = []

    def port_values(self, skipped: int) -> dict:
        """Return the bus's part of the diagnostics; skipped: ticks that an overrun skipped."""
        counters = device_values(self.port.counters) if self.port else {}
        values = {f"bus {name}": count for name, count in counters.items()}
        return {
            "bus": self.bus_name,
            **({"bus state": "bus-off"} if self.port and self.port.bus_off else {}),
            "bus load [%]": f"{100 * self.bus_load:.0f}",
            "skipped ticks": skipped,
            **values,
        }


def device_values(counters: Counter[str]) -> dict[str, int]:
    """Return the counters of a device or a bus that are not zero, for diagnostics."""
    return {name: count for name, count in counters.copy().items() if count}
