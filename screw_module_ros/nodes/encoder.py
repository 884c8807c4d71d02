# SPDX-License-Identifier: Apache-2.0
"""`encoder`: the vertical module's CiA 406 encoder; SYNC producer of its bus."""

from __future__ import annotations

import time

from screw_module_msgs.msg import EncoderSample
from std_srvs.srv import Trigger

from screw_module_ros.devices.encoder import Encoder
from screw_module_ros.devices.encoder_setup import EncoderSettings
from screw_module_ros.devices.errors import DeviceError
from screw_module_ros.geometry import Screw
from screw_module_ros.samples import EncoderReading

from .support import qos
from .support.driver import DriverNode, RateSettings, device_values
from .support.module_node import ERROR, OK, WARN, Health
from .support.rates import RateMeter
from .support.realtime import fill_stamp
from .support.runtime import main as run_node
from .support.timing_report import latency_values


class EncoderNode(DriverNode):
    """One sample a tick, published as soon as it is there."""

    def __init__(self):
        super().__init__("encoder", port=43113)
        self.parameters.declare(EncoderSettings, without=("rate",))
        self.parameters.declare(Screw)
        self._message = EncoderSample()
        self._rate = RateMeter()
        self.device: Encoder | None = None
        self.create_service(Trigger, "~/home", self._home)

    def connect(self) -> None:
        """Find and configure the encoder."""
        rate = self.parameters.read(RateSettings).rate
        settings = self.parameters.read(EncoderSettings)._replace(rate=rate)
        port = self.open_port(f"encoder node {settings.node_id}")
        self.device = Encoder(port, settings, screw=self.parameters.read(Screw))
        self.device.configure()
        self.hardware_id = self.device.identity
        self.check_bus_load(self.device.traffic)
        self._publisher = self.create_publisher(EncoderSample, "screw/encoder", qos.SAMPLE)
        self._publish = self._publisher.handle.publish

    def begin(self) -> None:
        """Let the samples flow."""
        self.device.start()
        self.start_clock()

    def end(self) -> None:
        """Stop the samples."""
        self.stop_clock()
        try:
            self.device.stop()
        except DeviceError as error:
            self.get_logger().warning(f"encoder not stopped: {error}")

    def disconnect(self) -> None:
        """Close the bus."""
        if self.device is not None and hasattr(self, "_publisher"):
            self.destroy_publisher(self._publisher)
            del self._publisher
        self.device = None
        self.close_port()

    def step(self) -> None:
        """One tick: SYNC out, position in, sample out."""
        reading = self.sample(self.device)
        if reading is not None:
            self.publish(reading)

    def publish(self, reading: EncoderReading) -> EncoderSample:
        """Publish a reading; return the message, which is used again for the next."""
        message = self._message
        fill_stamp(message, reading.stamp_ns)
        message.sequence = reading.sequence
        message.monotonic_ns = reading.monotonic_ns
        message.count = reading.count
        message.position = reading.position
        message.velocity = reading.velocity
        message.homed = reading.homed
        self._publish(message)
        return message

    def poll_slow(self) -> None:
        """Read alarms and warnings of the device."""
        self.device.poll_slow()

    def _home(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if not self.active:
            response.message = "the node is not active"
            return response
        try:
            if self.device.fault:
                self.device.clear_fault()
            height = self.device.home()
        except DeviceError as error:
            response.message = str(error)
            return response
        response.success = True
        response.message = f"homed at {height:g} m"
        return response

    def health(self) -> Health:
        """Rate, faults, counters."""
        device = self.device
        counters = device.snapshot()
        rate = self._rate.rate(counters.received, time.monotonic_ns())
        values = {
            "rate [1/s]": f"{rate:.1f}",
            **latency_values("answer", self.answers),
            "homed": device.homed,
            **device_values(counters),
            **self.port_values(),
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


if __name__ == "__main__":
    raise SystemExit(main())
