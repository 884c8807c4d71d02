# SPDX-License-Identifier: Apache-2.0
"""`encoder`: the vertical module's CiA 406 encoder; SYNC producer of its bus."""

from __future__ import annotations

from std_srvs.srv import Trigger

from screw_module_ros import graph
from screw_module_ros.devices.encoder import Encoder
from screw_module_ros.devices.encoder_setup import EncoderSettings
from screw_module_ros.devices.errors import DeviceError, NotNow
from screw_module_ros.geometry import Screw
from screw_module_ros.loop.vertical import Roles, Wires
from screw_module_ros.profiles import ENCODER, load
from screw_module_ros.samples import EncoderReading

from .support.answering import Done
from .support.driver import SensorNode, TorqueOff
from .support.states import OK, WARN, Health
from .support.wire import pack_encoder


class EncoderNode(SensorNode):
    """One sample per tick, published as soon as it arrives."""

    def __init__(self) -> None:
        super().__init__("encoder")
        self.parameters.declare(EncoderSettings, Screw)
        self.serve(Trigger, "~/home", self._home)

    def connect(self) -> None:
        """Find and configure the encoder."""
        settings = self.parameters.read(EncoderSettings)
        port = self.open_port(*settings.claims)
        profile = load(settings.profile, ENCODER)
        encoder = Encoder(port, settings, self.parameters.read(Screw), profile)
        self.add_device(encoder, graph.ENCODER, graph.ENCODER_DECIMATED)
        self._torque_off = TorqueOff(self, self.new_inbox(), self.clock)

    def begin(self) -> None:
        """Let the samples flow; an encoder that may have restarted unseen is configured anew."""
        if not self.device.configured:
            self.device.configure()
        self.start_samples(Wires(publish_sample=self.publish))
        self.roles = Roles(encoder=self.role)

    def end(self) -> None:
        """Stop the samples."""
        try:
            self.device.stop()
        except DeviceError as error:
            self.get_logger().warning(f"encoder not stopped: {error}")

    def publish(self, reading: EncoderReading) -> None:
        """Publish a reading."""
        self.publish_packed(pack_encoder(reading), reading.sequence)

    def _home(self, request: Trigger.Request) -> str:
        self._torque_off.check("would pull to another place")
        device = self.device
        cleared = bool(device.fault) or device.silent
        if cleared:
            device.clear_fault()  # takes seconds: the drive may have been enabled meanwhile
            self._torque_off.check("would pull to another place")
        try:
            return self.requests.ask(lambda: Done(f"homed at {device.home():g} m"))
        except NotNow as error:
            if cleared and not device.fault:
                raise NotNow(f"the fault is cleared; {error}") from None
            raise

    def health(self) -> Health:
        """Rate, faults, counters."""
        device = self.device
        health = self.sensor_health(
            {"homed": device.homed, "operating status": f"0x{device.operating_status:04x}"}
        )
        if health.level != OK:
            return health
        if device.warnings:
            return health._replace(
                level=WARN, message=f"encoder warns: {', '.join(device.warnings)}"
            )
        return health._replace(message="homed" if device.homed else "not homed: call ~/home")
