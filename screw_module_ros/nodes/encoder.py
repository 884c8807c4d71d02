# SPDX-License-Identifier: Apache-2.0
"""`encoder`: the vertical module's CiA 406 encoder; SYNC producer of its bus."""

from __future__ import annotations

from std_srvs.srv import Trigger

from screw_module_ros import graph
from screw_module_ros.devices.encoder import Encoder
from screw_module_ros.devices.encoder_setup import EncoderSettings
from screw_module_ros.devices.errors import DeviceError, NotHomed
from screw_module_ros.geometry import Screw
from screw_module_ros.loop.sensor import PolledSensor
from screw_module_ros.loop.vertical import Parts, VerticalLoop, Wires
from screw_module_ros.samples import EncoderReading

from .support.driver import DriverNode, RateSettings, device_values
from .support.flat import pack_encoder
from .support.health import ERROR, OK, WARN, Health
from .support.rates import RateMeter
from .support.runtime import main as run_node
from .support.serving_node import Done
from .support.timing_report import latency_values
from .support.topics import offered
from .support.torque_off import TorqueOff


class EncoderNode(DriverNode):
    """One sample per tick, published as soon as it arrives."""

    def __init__(self):
        super().__init__("encoder")
        self.parameters.declare(EncoderSettings, without=("rate",))
        self.parameters.declare(Screw)
        self._rate = RateMeter()
        self.device: Encoder | None = None
        self.serve(Trigger, "~/home", self._home)

    def connect(self) -> None:
        """Find and configure the encoder."""
        rate = self.parameters.read(RateSettings).rate
        settings = self.parameters.read(EncoderSettings)._replace(rate=rate)
        port = self.open_port(f"encoder node {settings.node_id}")
        self.device = Encoder(port, settings, screw=self.parameters.read(Screw))
        self.device.configure()
        self.hardware_id = self.device.identity
        self.check_bus_load(self.device.traffic)
        self._publish = self.outlet(*offered(graph.ENCODER), raw=True)
        self._publish_slow = self.outlet(*offered(graph.ENCODER_DECIMATED), raw=True)
        self._slow_every = max(1, round(rate / graph.DECIMATED_RATE))
        self._torque_off = TorqueOff(self.new_inbox(), self.clock)

    def begin(self) -> None:
        """Let the samples flow; an encoder that may have restarted unseen is configured anew."""
        if not self.device.configured:
            self.device.configure()
        self.device.start()
        self.part = PolledSensor(self.device, self.port, self.clock)
        self._loop = VerticalLoop(self.clock, self.period_ns, Wires(publish_sample=self.publish))
        device = self.device  # the loop may still ask while `disconnect` takes it away
        self.start_polls(lambda: device.fault)

    def end(self) -> None:
        """Stop the samples."""
        self.stop_polls()
        try:
            self.device.stop()
        except DeviceError as error:
            self.get_logger().warning(f"encoder not stopped: {error}")

    def disconnect(self) -> None:
        """Close the bus."""
        self.device = None
        self.close_port()

    def step(self) -> None:
        """One tick: SYNC out, position in, sample out."""
        self._loop.step(Parts(encoder=self.part))

    def publish(self, reading: EncoderReading) -> None:
        """Publish a reading."""
        data = pack_encoder(reading)
        self._publish(data)
        if reading.sequence % self._slow_every == 0:
            self._publish_slow(data)

    def poll_slow(self) -> None:
        """Read alarms and warnings of the device."""
        self.device.poll_slow()

    def _home(self, request: Trigger.Request) -> Done:
        self._torque_off.check("would pull to another place")
        device = self.device
        cleared = bool(device.fault)
        if cleared:
            device.clear_fault()
        try:
            return Done(f"homed at {device.home():g} m")
        except NotHomed as error:
            if cleared and not device.fault:
                raise NotHomed(f"the fault is cleared; {error}") from None
            raise

    def health(self) -> Health:
        """Rate, faults, counters."""
        device = self.device
        counters = device.snapshot()
        rate = self._rate.rate(counters.received, self.clock.now_ns())
        values = {
            "rate [1/s]": f"{rate:.1f}",
            **latency_values("answer", self.part.answers),
            "homed": device.homed,
            **device_values(counters),
            **self.port_values(self.part.skipped),
        }
        if device.fault:
            return Health(ERROR, device.fault, values)
        if rate < 0.5e9 / self.period_ns:
            return Health(ERROR, f"only {rate:.0f} samples/s", values)
        if device.warnings:
            return Health(WARN, f"encoder warns: {', '.join(device.warnings)}", values)
        return Health(OK, "homed" if device.homed else "not homed: call ~/home", values)


def main() -> int:
    """Console entry point."""
    return run_node(EncoderNode)
