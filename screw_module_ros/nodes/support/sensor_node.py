# SPDX-License-Identifier: Apache-2.0
"""Base of `encoder` and `force_sensor`: one sensor, asked on each tick, each reading published."""

from __future__ import annotations

from typing import Any

from screw_module_ros import graph
from screw_module_ros.loop.sensor import PolledSensor
from screw_module_ros.loop.vertical import Parts, VerticalLoop, Wires

from .driver import DriverNode, device_values
from .health import ERROR, OK, Health
from .rates import RateMeter
from .timing_report import latency_values
from .topics import offered


class SensorNode(DriverNode):
    """A node with one sensor. Subclasses define `connect`, `begin`, `end`, `publish`.

    device: the sensor's driver, None while there is none. part: its part in the loop, while active.
    """

    def __init__(self, name: str):
        super().__init__(name)
        self._rate = RateMeter()
        self.device: Any = None
        self.part: PolledSensor | None = None

    def add_device(self, device: Any, topic: str, decimated: str) -> None:
        """Configure the device and offer the topics of its readings; raises DeviceError."""
        self.device = device
        device.configure()
        self.hardware_id = device.identity
        self.check_bus_load(device.traffic)
        self._publish = self.outlet(*offered(topic), raw=True)
        self._publish_slow = self.outlet(*offered(decimated), raw=True)
        self._slow_every = max(1, round(1e9 / self.period_ns / graph.DECIMATED_RATE))

    def start_samples(self, parts: str, wires: Wires) -> None:
        """Start device and loop. parts: name of this sensor in `Parts`."""
        self.device.start()
        self.part = PolledSensor(self.device, self.port, self.clock)
        self._parts = Parts(**{parts: self.part})
        self._loop = VerticalLoop(self.clock, self.period_ns, wires)
        device = self.device  # the loop may still ask while `disconnect` takes it away
        self.start_polls(lambda: device.fault)

    def disconnect(self) -> None:
        """Close the bus."""
        self.device = None
        self.close_port()

    def step(self) -> None:
        """One tick: request out, reading in, sample out."""
        self._loop.step(self._parts)

    def publish_packed(self, data: bytes, sequence: int) -> None:
        """Publish a reading's message, each n-th also on the decimated topic."""
        self._publish(data)
        if sequence % self._slow_every == 0:
            self._publish_slow(data)

    def poll_slow(self) -> None:
        """Read the device's slow values, such as alarms or voltages."""
        self.device.poll_slow()

    def sensor_health(self, shown: dict) -> Health:
        """Return rate, faults and counters; shown: further values."""
        device = self.device
        counters = device.counters
        rate = self._rate.rate(counters["received"], self.clock.now_ns())
        values = {
            "rate [1/s]": f"{rate:.1f}",
            **latency_values("answer", self.part.answers),
            **shown,
            **device_values(counters),
            **self.port_values(self.part.skipped),
        }
        if device.fault:
            return Health(ERROR, device.fault, values)
        if rate < 0.5e9 / self.period_ns:
            return Health(ERROR, f"only {rate:.0f} samples/s", values)
        return Health(OK, "sampling", values)
