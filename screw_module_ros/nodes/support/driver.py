# SPDX-License-Identifier: Apache-2.0
"""Base of the nodes with CAN devices: bus, device locks, sensors, torque off."""

from __future__ import annotations

from collections import Counter
from contextlib import suppress
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from screw_module_msgs.msg import AmplifierState, PlanarState

from screw_module_ros import graph, plugins
from screw_module_ros.can_io.bus import BusSettings, open_port, where, within
from screw_module_ros.can_io.load import check_load
from screw_module_ros.can_io.port import Port
from screw_module_ros.clock import Clock, TimeStandsStill
from screw_module_ros.devices.canopen import CanopenDevice
from screw_module_ros.devices.errors import DeviceError, NotConfigured, NotNow, Refused
from screw_module_ros.locks import lock_device, runs
from screw_module_ros.loop.sensor import PolledSensor
from screw_module_ros.loop.ticker import period_of
from screw_module_ros.loop.vertical import Roles, VerticalLoop, Wires
from screw_module_ros.settings import Setting

from .inbox import Inbox
from .node import Node
from .states import ERROR, OK, Health, RateMeter, latency_values
from .topics import Newest, offered, requested

if TYPE_CHECKING:
    from screw_module_ros.devices.polled import Line

_SLOW_POLL_S = 5.0
# Longer than the supervisor waits for it (`timeout`) and the drives for the supervisor
# (`gate.safety_timeout`): the torque of an amplifier that is silent for so long is off.
_STATE_S = 0.4
_LOOKS = 15
_DRIVES = {"amplifier": "vertical drive", "manus": "plane"}


class RateSettings(NamedTuple):
    """The node ticks at whole multiples of one period of its clock."""

    rate: Annotated[float, Setting("ticks per second, one tick a period", "Hz", 50.0, 4000.0)] = (
        1000.0
    )


class DriverNode(Node):
    """A node with one CAN bus and its own tick rate."""

    def __init__(self, name: str, rate: float = 1000.0):
        super().__init__(name)
        self.parameters.declare_with(BusSettings, "can", channel=graph.bus_of(name))
        self.parameters.declare_with(RateSettings, rate=rate)
        self.bus_load = 0.0
        self.port: Any = None  # a Port, or the Line of a sensor that is not on CAN
        self._told_makes = ""

    # For subclasses ------------------------------------------------------------------------

    def open_port(self, *devices: str) -> Port:
        """Open the bus and lock `devices` for this process; raises BusError, AlreadyRunning."""
        bus = within(self.parameters.read(BusSettings, "can"), self.get_namespace())
        self.bus_name = where(bus)
        self.period_ns = period_of(self.parameters.read(RateSettings).rate)
        for device in devices:
            self.opened.callback(lock_device(self.bus_name, device).release)
        port = open_port(bus, self.clock)
        self.port = port
        self.opened.callback(port.close)
        return port

    def take_line(self, line: Line) -> None:
        """Use what a driver has opened by itself in place of the CAN bus, if it has."""
        if self.port is not line:
            self.port, self.bus_name = line, line.name
            self.period_ns = period_of(self.parameters.read(RateSettings).rate)
            self.opened.callback(line.close)

    def configure_device(self, device: Any) -> None:
        """Configure a device; if it is another make than its profile says, tell which comes close.

        A node tries again each second: the same table is told once. Raises DeviceError.
        """
        try:
            device.configure()
        except (Refused, NotConfigured):
            if isinstance(device, CanopenDevice):
                with suppress(DeviceError):
                    self._tell_makes(device.likely_makes())
            raise
        for told in device.set_back if isinstance(device, CanopenDevice) else ():
            self.get_logger().warning(told)

    def _tell_makes(self, table: str) -> None:
        if table != self._told_makes:
            self._told_makes = table
            self.get_logger().error(table)

    def check_bus_load(self, traffic: list) -> None:
        """Warn above 80 % of the bus, raise BusOverload above 100 % (`can_io/load.py`)."""
        bus = self.parameters.read(BusSettings, "can")
        self.bus_load, warning = check_load(traffic, bus.bitrate, self.bus_name)
        if warning:
            self.get_logger().warning(warning)

    def port_values(self, skipped: int) -> dict:
        """Return the bus's part of the diagnostics; skipped: ticks that an overrun skipped."""
        counters = device_values(self.port.counters)
        return {
            "bus": self.bus_name,
            **({"bus state": "bus-off"} if self.port.bus_off else {}),
            "bus load [%]": f"{100 * self.bus_load:.0f}",
            "skipped ticks": skipped,
            **{f"bus {name}": count for name, count in counters.items()},
        }


def device_values(counters: Counter[str]) -> dict[str, int]:
    """Return the counters of a device or a bus that are not zero, for diagnostics."""
    return {name: count for name, count in counters.copy().items() if count}


class SensorNode(DriverNode):
    """A node with one sensor. Subclasses define `connect`, `begin`, `end`, `publish`.

    device: the sensor's driver, from `connect` on. role: its role in the loop, from `begin` on;
    roles: those of its loop.
    """

    device: Any
    roles: Roles

    def __init__(self, name: str):
        super().__init__(name)
        self._rate = RateMeter()
        self.periodic.every(self.clock, _SLOW_POLL_S, self._poll_slow)

    def add_device(self, device: Any, topic: str, decimated: str) -> None:
        """Configure the device and offer the topics of its readings; raises DeviceError."""
        self.device = device
        self.configure_device(device)
        self.hardware_id = device.identity
        self.check_bus_load(device.traffic)
        self._publish = self.outlet(*offered(topic), raw=True)
        self._publish_slow = self.outlet(*offered(decimated), raw=True)
        self._slow_every = max(1, round(1e9 / self.period_ns / graph.DECIMATED_RATE))

    def start_samples(self, wires: Wires) -> None:
        """Start device and loop; `roles` comes next."""
        self.device.start()
        self.role = PolledSensor(self.device, self.port, self.clock)
        self._loop = VerticalLoop(self.clock, self.period_ns, wires)

    def step(self) -> None:
        """One tick: request out, reading in, sample out."""
        self._loop.step(self.roles)

    def publish_packed(self, data: bytes, sequence: int) -> None:
        """Publish a reading's message, each n-th also on the decimated topic."""
        self._publish(data)
        if sequence % self._slow_every == 0:
            self._publish_slow(data)

    @property
    def alarm(self) -> str:
        """The device's latched fault."""
        return self.device.fault

    def _poll_slow(self) -> None:
        """Read the device's slow values, such as alarms or voltages.

        A driver may be somebody else's: the node does not end by what it raises.
        """
        if not self.active:
            return
        try:
            self.device.poll_slow()
        except TimeStandsStill:
            raise
        except BaseException as error:
            self.device.counters["slow_polls_failed"] += 1
            self.get_logger().warning(f"slow values: {plugins.told(error)}")

    def sensor_health(self, shown: dict) -> Health:
        """Return rate, faults and counters; shown: further values."""
        device = self.device
        counters = device.counters
        rate = self._rate.rate(counters["received"], self.clock.now_ns())
        values = {
            "rate [1/s]": f"{rate:.1f}",
            **latency_values("answer", self.role.answers),
            **shown,
            **device_values(counters),
            **self.port_values(self.role.skipped),
        }
        if alarm := self.alarm:  # once: the loop may end it meanwhile
            return Health(ERROR, alarm, values)
        if rate < 0.5e9 / self.period_ns:
            return Health(ERROR, f"only {rate:.0f} samples/s", values)
        return Health(OK, "sampling", values)


class TorqueOff:
    """Subscribes to the states of drives for the service thread. inbox: of the node; topics: of
    the states, one for each node with drives that must give no torque."""

    def __init__(
        self, node: Node, inbox: Inbox, clock: Clock,
        topics: tuple[str, ...] = (graph.AMPLIFIER_STATE,),
    ):  # fmt: skip
        self._node, self._clock = node, clock
        self._states = {
            graph.TOPICS[topic].publisher: Newest(inbox.subscribe(*requested(topic)), 0)
            for topic in topics
        }

    def check(self, why: str) -> None:
        """Raise NotNow when the next state of a node shows that torque passes or may pass.

        why: the consequence, for the message. A silent node passes no torque, but one that the
        middleware has not discovered yet may: it has 3 s for that.
        """
        for name, newest in self._states.items():
            for _ in range(_LOOKS):
                state = self._next_state(newest)
                if state is not None or not self._is_undiscovered(name):
                    break
            else:
                raise NotNow(
                    f"{name} runs, but this node has not discovered it yet: try again in a moment"
                )
            if state is not None and may_pass_torque(state):
                raise NotNow(
                    f"the {_DRIVES[name]} is enabled and {why}: disable it first ({name}/enable)"
                )

    def _next_state(self, newest: Newest) -> Any:
        """Return a node's next state, None while it is silent."""
        newest.update(0)
        newest.forget()  # a waiting message may be old
        self._clock.wait_for(lambda: newest.update(0), _STATE_S)
        return newest.message

    def _is_undiscovered(self, name: str) -> bool:
        """Return whether a node runs on this machine and the graph does not show it."""
        namespace = self._node.get_namespace()
        if (name, namespace) in self._node.get_node_names_and_namespaces():
            return False
        return runs(f"{namespace.rstrip('/')}/{name}")


def may_pass_torque(state: AmplifierState | PlanarState) -> bool:
    """Return whether torque passes, or somebody else has enabled a drive of this node."""
    states = (state.state,) if isinstance(state, AmplifierState) else tuple(state.drive_state)
    return state.enabled or AmplifierState.OPERATION_ENABLED in states
