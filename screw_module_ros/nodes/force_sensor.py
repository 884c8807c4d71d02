# SPDX-License-Identifier: Apache-2.0
"""`force_sensor`: the six-axis ATI sensor at the handle, polled on the tick."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from geometry_msgs.msg import WrenchStamped
from std_srvs.srv import Trigger

from screw_module_ros import graph
from screw_module_ros.devices.force_sensor import ForceSensor, ForceSensorSettings
from screw_module_ros.loop.sensor import PolledSensor
from screw_module_ros.loop.vertical import Parts, VerticalLoop, Wires
from screw_module_ros.samples import ForceReading
from screw_module_ros.settings import Setting

from .support.driver import DriverNode, RateSettings, device_values
from .support.flat import pack_force
from .support.health import ERROR, OK, Health
from .support.rates import RateMeter
from .support.runtime import main as run_node
from .support.serving_node import Done
from .support.states import fill_wrench
from .support.timing_report import latency_values
from .support.topics import offered
from .taring import Taring


class WrenchSettings(NamedTuple):
    """The slow copy of the force for tools."""

    wrench_rate: Annotated[
        float, Setting(f"{graph.WRENCH} messages per second", "Hz", 1.0, 500.0)
    ] = graph.TOPICS[graph.WRENCH].rate


class ForceSensorNode(DriverNode):
    """One wrench per tick, of the patient on the robot."""

    def __init__(self):
        super().__init__("force_sensor")
        self.parameters.declare(ForceSensorSettings, without=("rate",))
        self.parameters.declare(WrenchSettings)
        self._wrench = WrenchStamped()
        self._wrench.header.frame_id = "handle"
        self._rate = RateMeter()
        self.device: ForceSensor | None = None
        self.serve(Trigger, "~/tare", self._tare)
        self.serve(Trigger, "~/untare", self._untare)

    def connect(self) -> None:
        """Find the sensor and read its calibration."""
        rate = self.parameters.read(RateSettings).rate
        settings = self.parameters.read(ForceSensorSettings)._replace(rate=rate)
        port = self.open_port(f"force sensor 0x{settings.base_id:02x}")
        self.device = ForceSensor(port, settings)
        self.device.configure()
        self.hardware_id = self.device.identity
        self.check_bus_load(self.device.traffic)
        wrench_rate = self.parameters.read(WrenchSettings).wrench_rate
        self._wrench_every = max(1, round(rate / wrench_rate))
        self._publish = self.outlet(*offered(graph.FORCE), raw=True)
        self._publish_slow = self.outlet(*offered(graph.FORCE_DECIMATED), raw=True)
        self._slow_every = max(1, round(rate / graph.DECIMATED_RATE))
        self._send_wrench = self.outlet(*offered(graph.WRENCH))
        self._taring = Taring(self.new_inbox(), self.clock)

    def begin(self) -> None:
        """Start the samples; an activation also clears a latched fault."""
        if self.device.fault:
            self.device.clear_fault()
        self.device.start()
        self.part = PolledSensor(self.device, self.port, self.clock)
        self._loop = VerticalLoop(self.clock, self.period_ns, Wires(publish_force=self.publish))
        device = self.device  # the loop may still ask while `disconnect` takes it away
        self.start_polls(lambda: device.fault)

    def end(self) -> None:
        """Stop polling."""
        self.stop_polls()
        self.device.stop()

    def disconnect(self) -> None:
        """Close the bus."""
        self.device = None
        self.close_port()

    def step(self) -> None:
        """One tick: send the request, wait for both halves, publish."""
        self._loop.step(Parts(force_sensor=self.part))

    def publish(self, reading: ForceReading) -> None:
        """Publish a reading, and collect it while taring."""
        data = pack_force(reading)
        self._publish(data)
        if reading.sequence % self._slow_every == 0:
            self._publish_slow(data)
        if reading.sequence % self._wrench_every == 0:
            fill_wrench(self._wrench, reading)
            self._send_wrench(self._wrench)
        self._taring.note(reading)

    def _tare(self, request: Trigger.Request) -> str:
        self._taring.permitted()
        if self.device.fault:
            self.device.clear_fault()
        readings = self._taring.gathered(self.device.settings.tare_samples)
        self._taring.permitted()  # somebody may have enabled meanwhile
        return Done(f"tared, removing {_bias_text(self.device.tare(readings))}")

    def _untare(self, request: Trigger.Request) -> str:
        self._taring.permitted()
        return Done(f"back to removing {_bias_text(self.device.untare())}")

    def poll_slow(self) -> None:
        """Read the supply and temperature voltages."""
        self.device.poll_slow()

    def health(self) -> Health:
        """Rate, faults, counters. A fault stays until ~/tare or a new activation clears it."""
        device = self.device
        counters = device.snapshot()
        rate = self._rate.rate(counters.received, self.clock.now_ns())
        values = {
            "rate [1/s]": f"{rate:.1f}",
            **latency_values("answer", self.part.answers),
            "bias": _bias_text(device.bias),
            **{f"{name} [ADC counts]": count for name, count in device.voltages.items()},
            **device_values(counters),
            **self.port_values(self.part.skipped),
        }
        if device.fault:
            return Health(ERROR, device.fault, values)
        if rate < 0.5e9 / self.period_ns:
            return Health(ERROR, f"only {rate:.0f} samples/s", values)
        return Health(OK, "sampling", values)


def _bias_text(bias: tuple) -> str:
    force = ", ".join(f"{x:.2f}" for x in bias[:3])
    torque = ", ".join(f"{x:.3f}" for x in bias[3:])
    return f"{force} N and {torque} Nm"


def main() -> int:
    """Console entry point."""
    return run_node(ForceSensorNode)
