# SPDX-License-Identifier: Apache-2.0
"""`force_sensor`: the six-axis sensor at the handle, polled on the tick."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

from geometry_msgs.msg import WrenchStamped
from std_srvs.srv import Trigger

from screw_module_ros import graph
from screw_module_ros.devices import force_sensors
from screw_module_ros.devices.errors import NotNow
from screw_module_ros.devices.force_sensor_settings import ForceSensorSettings
from screw_module_ros.devices.tare import zero_error
from screw_module_ros.loop.vertical import Roles, Wires
from screw_module_ros.samples import ForceReading
from screw_module_ros.settings import Setting

from .support.answering import Done
from .support.driver import SensorNode, TorqueOff
from .support.inbox import fill_stamp
from .support.states import OK, WARN, Health
from .support.topics import offered
from .support.wire import pack_force

_GATHER_S = 3.0
_WATCHED_S = 2.0  # time of quiet force after which nobody seems to hold the handle
_JUMPS = "would jump"
_FED_BACK = graph.AMPLIFIER_STATE, graph.MANUS_STATE  # states of the axes that feed the force back
_ZERO_ERROR = "error of the zero, if nothing hangs on the handle"


class WrenchSettings(NamedTuple):
    """The slow copy of the force for tools."""

    wrench_rate: Annotated[
        float, Setting(f"{graph.WRENCH} messages per second", "Hz", 1.0, 500.0)
    ] = graph.TOPICS[graph.WRENCH].rate


class ForceSensorNode(SensorNode):
    """One wrench per tick, of the patient on the robot."""

    def __init__(self) -> None:
        super().__init__("force_sensor")
        self.parameters.declare(ForceSensorSettings, WrenchSettings)
        self._gathering: list[ForceReading] | None = None  # for the service that tares
        self._recent: list[ForceReading] = []  # replaced, never changed: health reads it too
        self._wrench = WrenchStamped()
        self._wrench.header.frame_id = "handle"
        self.serve(Trigger, "~/tare", self._tare, then=self.publish_health)
        self.serve(Trigger, "~/untare", self._untare, then=self.publish_health)

    def connect(self) -> None:
        """Find the sensor and read its calibration."""
        settings = self.parameters.read(ForceSensorSettings)
        device = force_sensors.driver(settings, self.open_port, self.clock)
        self.take_line(device.port)
        self.add_device(device, graph.FORCE, graph.FORCE_DECIMATED)
        wrench_rate = self.parameters.read(WrenchSettings).wrench_rate
        self._wrench_every = max(1, round(settings.rate / wrench_rate))
        self._watched = round(_WATCHED_S * settings.rate / self._wrench_every)
        self._send_wrench = self.outlet(*offered(graph.WRENCH))
        self._torque_off = TorqueOff(self, self.new_inbox(), self.clock, _FED_BACK)

    def begin(self) -> None:
        """Start the samples; an activation also clears a latched fault.

        A sensor that may have restarted unseen is configured anew.
        """
        if self.device.fault or self.port.failed:
            self.device.clear_fault()
        if not self.device.configured:
            self.device.configure()
        self._recent = []
        self.start_samples(Wires(publish_force=self.publish))
        self.roles = Roles(force_sensor=self.role)

    def end(self) -> None:
        """Stop polling."""
        self.device.stop()

    def publish(self, reading: ForceReading) -> None:
        """Publish a reading, and collect it while taring."""
        self.publish_packed(pack_force(reading), reading.sequence)
        if reading.sequence % self._wrench_every == 0:
            _fill_wrench(self._wrench, reading)
            self._send_wrench(self._wrench)
            self._recent = [*self._recent[1 - self._watched :], reading]
        gathering = self._gathering  # the service may end the collection meanwhile
        if gathering is not None:
            gathering.append(reading)

    def _tare(self, request: Trigger.Request) -> str:
        """Tare, only while no drive gives torque.

        With force feedback the patient would feel the removed bias at once, multiplied by the gain.
        """
        device = self.device
        self._torque_off.check(_JUMPS)
        if cleared := bool(device.fault) or self.port.failed:
            device.clear_fault()
        readings = self._next_readings(device.settings.tare_samples)
        self._torque_off.check(_JUMPS)  # somebody may have enabled meanwhile
        try:
            return self.requests.ask(
                lambda: Done(f"tared, removing {_bias_text(device.tare(readings))}")
            )
        except NotNow as error:
            if cleared and not device.fault:
                raise NotNow(f"the fault is cleared, but there is no new zero: {error}") from None
            raise

    def _next_readings(self, count: int) -> list[ForceReading]:
        """Return the next `count` readings; fewer if they do not come in time."""
        readings = self._gathering = []
        self.clock.wait_for(lambda: len(readings) >= count, _GATHER_S)
        self._gathering = None
        return readings[:count]

    def _untare(self, request: Trigger.Request) -> str:
        self._torque_off.check(_JUMPS)
        device = self.device
        return self.requests.ask(
            lambda: Done(f"back to removing {_bias_text(device.untare())}")
        )

    def health(self) -> Health:
        """Rate, faults, counters. A fault stays until ~/tare or a new activation clears it."""
        device = self.device
        shown = {"bias": _bias_text(device.bias), _ZERO_ERROR: self._zero_error(), **device.shown}
        health = self.sensor_health(shown)
        if health.level == OK and not device.tared:
            # Force feedback would press with a multiple of it.
            text = (
                "not tared since the sensor's start: the handle's weight may count as the "
                "patient's force; call ~/tare"
            )
            return health._replace(level=WARN, message=text)
        return health

    def _zero_error(self) -> str:
        recent = self._recent
        found = zero_error(recent) if recent and len(recent) == self._watched else None
        return _force_text(found) if found else "somebody may hold the handle"


def _fill_wrench(message: WrenchStamped, reading: ForceReading) -> None:
    """Write a force sample into the message for tools."""
    fill_stamp(message.header, reading.stamp_ns)
    force, torque = message.wrench.force, message.wrench.torque
    force.x, force.y, force.z = reading.fx, reading.fy, reading.fz
    torque.x, torque.y, torque.z = reading.tx, reading.ty, reading.tz


def _bias_text(bias: tuple) -> str:
    torque = ", ".join(f"{x:.3f}" for x in bias[3:])
    return f"{_force_text(bias[:3])} and {torque} Nm"


def _force_text(force: Sequence[float]) -> str:
    return f"{', '.join(f'{x:.2f}' for x in force)} N"
