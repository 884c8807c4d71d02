# SPDX-License-Identifier: Apache-2.0
"""The whole vertical axis in one thread: real drivers and laws, virtual buses, the simulated rig.

Time is a number that `tick` raises by one period; the rig moves one period per SYNC. Only the SDO
conversations of the configuration run on the wall clock, with the rig served by a thread.
"""

from __future__ import annotations

import math
import threading
import time
import uuid
from typing import NamedTuple

import can

from screw_module_ros.axes.controller import VerticalController
from screw_module_ros.axes.joint import JointSettings
from screw_module_ros.axes.planar import PlanarAxes
from screw_module_ros.axes.vertical import VerticalAxis
from screw_module_ros.calibration.friction import load_friction_model
from screw_module_ros.control.agreement import AgreementSettings
from screw_module_ros.control.gate import OPEN, GateSettings
from screw_module_ros.control.limits import CommandLimits, TorqueLimits
from screw_module_ros.control.linearization import default_linearization
from screw_module_ros.control.planar_settings import PlanarSettings
from screw_module_ros.control.torque_chain import torque_chain
from screw_module_ros.control.vertical_settings import VerticalSettings
from screw_module_ros.control.watch import WatchSettings
from screw_module_ros.devices.drive import Drive
from screw_module_ros.devices.drive_settings import DriveSettings
from screw_module_ros.devices.encoder import Encoder
from screw_module_ros.devices.encoder_setup import EncoderSettings
from screw_module_ros.devices.errors import BusError
from screw_module_ros.devices.force_sensor import ForceSensor, ForceSensorSettings
from screw_module_ros.devices.heartbeat import Heartbeat
from screw_module_ros.devices.port import Port
from screw_module_ros.geometry import SCREW
from screw_module_ros.plant.world import World, load_world
from screw_module_ros.resources import resource_path
from screw_module_ros.rig.rig import Rig

PERIOD_NS = 1_000_000
BUSES = ("encoder", "drive", "force_sensor", "planar")
_COMMAND_DELAY_NS = 250_000


class Row(NamedTuple):
    """What one tick came to; force: commanded, patient: on the handle, both [N]."""

    time: float
    position: float
    velocity: float
    patient: float
    force: float
    torque: float
    reason: str


class Bench:
    """One robot. `tick` is one period; `rows` is what happened."""

    def __init__(self, seed: int = 1, drive: DriveSettings | None = None):
        name = uuid.uuid4().hex
        self._buses = []
        far = {bus: self._bus(f"{name}-{bus}") for bus in BUSES}
        self.world = World(load_world(), seed)
        self.rig = Rig(far, self.world, clock="sync", period_ns=PERIOD_NS)
        self.now_ns = time.monotonic_ns()
        self._configuring = True
        self.ports = {
            bus: Port(self._bus(f"{name}-{bus}"), clock=self._clock) for bus in BUSES
        }
        self.home = self.world.settings.start.position
        self.encoder = Encoder(self.ports["encoder"], EncoderSettings(home_position=self.home))
        self.force_sensor = ForceSensor(self.ports["force_sensor"], ForceSensorSettings())
        self.drive = Drive(self.ports["drive"], drive or DriveSettings(), per_turn=SCREW.lead)
        beat = Heartbeat(self.ports["planar"], 113, 0.025)
        self.planar_drives = tuple(
            Drive(
                self.ports["planar"],
                DriveSettings(node_id=node, master_id=113, rated_torque=10.0, max_torque=25.0,
                              counts_per_turn=65536),  # fmt: skip
                f"{label} drive",
                beat,
            )
            for node, label in ((3, "shoulder"), (4, "elbow"))
        )
        self.controller = VerticalController(
            VerticalSettings(),
            load_friction_model(resource_path("params/friction_thesis.yaml")),
            WatchSettings(),
            AgreementSettings(),
            PERIOD_NS,
        )
        self.axis = VerticalAxis(
            self.drive,
            PERIOD_NS,
            GateSettings(),
            torque_chain(CommandLimits(), TorqueLimits(), default_linearization(), SCREW, 0.42),
        )
        self.axes = PlanarAxes(
            self.planar_drives, PERIOD_NS, PlanarSettings(), JointSettings(), GateSettings()
        )
        self.setpoint = (math.nan, 0.0)
        self.planar_setpoint = (math.nan, math.nan, 0.0, 0.0)
        self.permitted = True
        self.commanding = True
        self.rows: list[Row] = []
        self._readings: list = []
        self._hand = math.nan, math.nan
        self._sequence = 0
        self.devices = (self.encoder, self.force_sensor, self.drive, *self.planar_drives)

    def _bus(self, channel: str) -> can.BusABC:
        bus = can.Bus(interface="virtual", channel=channel)
        self._buses.append(bus)
        return bus

    def _clock(self) -> int:
        return time.monotonic_ns() if self._configuring else self.now_ns

    # Bring-up ------------------------------------------------------------------------------

    def connect(self) -> None:
        """Configure and start every device against the rig."""
        with self.serving():
            for device in self.devices:
                device.configure()
            for device in self.devices:
                device.start()
        self.now_ns = time.monotonic_ns()

    def serving(self):
        """Return a context in which a thread serves the rig, for blocking conversations."""
        return _Served(self)

    def ready(self) -> None:
        """Connect, home, tare, and let the gate have fresh commands."""
        self.connect()
        self.ticks(30)
        self.encoder.home()
        assert self.axes.home(self.now_ns) == ""
        self.force_sensor.tare(self.gather(120))
        self.ticks(20)

    def gather(self, count: int) -> list:
        """Return the force readings of `count` ticks."""
        self._readings = []
        self.ticks(count)
        return self._readings

    def enable(self) -> str:
        """Enable the vertical axis; return why not."""
        return self._asking(lambda wait: self.axis.drives.enable(wait))

    def enable_plane(self) -> str:
        """Enable the planar axes; return why not."""
        return self._asking(lambda wait: self.axes.enable(wait))

    def clear_fault(self) -> str:
        """Clear the vertical axis's faults; return what is left."""
        return self._asking(lambda wait: self.axis.drives.clear_fault(wait))

    def _asking(self, ask) -> str:
        """Run a service in a thread while the loop ticks, as in the node."""
        answer: list[str] = []
        pause = threading.Event()
        thread = threading.Thread(target=lambda: answer.append(ask(lambda _s: pause.wait(1e-4))))
        thread.start()
        while thread.is_alive():
            self.tick()
        thread.join()
        return answer[0]

    # Running -------------------------------------------------------------------------------

    def ticks(self, count: int) -> list[Row]:
        """Run `count` ticks; return their rows."""
        for _ in range(count):
            self.tick()
        return self.rows[-count:]

    def seconds(self, duration: float) -> list[Row]:
        """Run for `duration` [s] of simulated time; return the rows."""
        return self.ticks(round(duration * 1e9 / PERIOD_NS))

    def tick(self) -> None:
        """One period: SYNC and polls out, answers in, laws, commands out."""
        self.now_ns += PERIOD_NS
        self._sequence += 1
        now, sequence = self.now_ns, self._sequence
        try:
            self._ask(sequence, now)
        except BusError:
            pass
        self.rig.process(now)
        for port in self.ports.values():
            port.pump(0.0)
        self._act(now + _COMMAND_DELAY_NS)
        self.rig.process(now + _COMMAND_DELAY_NS)

    def _ask(self, sequence: int, now: int) -> None:
        self.encoder.request(sequence, now, now)
        self.force_sensor.request(sequence, now, now)
        self.drive.sync(now)
        self.drive.heartbeat(now)
        self.axes.request(now)
        self._asked_ns = now

    def _act(self, now: int) -> None:
        controller, axis = self.controller, self.axis
        axis.drives.permit(self.permitted, "" if self.permitted else "test", now)
        self.axes.drives.permit(self.permitted, "" if self.permitted else "test", now)
        force = self.force_sensor.reading()
        if force is not None:
            self._readings.append(force)
            self._hand = force.fx, force.fy
            controller.force(force, now)
        reading = self.drive.reading
        metres = reading.position if reading else 0.0
        controller.amplifier(axis.drives.enabled, metres, now)
        sample = self.encoder.reading()
        output = controller.act(sample, self.setpoint, now) if sample else controller.idle(now)
        if output is not None and sample is not None and self.commanding:
            axis.command(sample.sequence, sample.monotonic_ns, output.force, now)
        axis.idle(now)
        self._act_in_plane(now)
        self.rows.append(
            Row(
                self.world.simulated_time,
                sample.position if sample else math.nan,
                sample.velocity if sample else math.nan,
                controller.handle_force,
                controller.output.force,
                axis.last.command,
                axis.drives.reason or controller.reason,
            )
        )

    def _act_in_plane(self, now: int) -> None:
        if self.axes.answered(self._answered_since()):
            self.axes.act(self.planar_setpoint, now, self._hand)
        else:
            self.axes.idle(now)

    def _answered_since(self) -> int:
        # Frames are stamped with the port's clock, which stands still within a tick.
        return self._asked_ns

    @property
    def torque_passes(self) -> bool:
        """Whether the gate is open."""
        return self.axis.drives.gate.phase == OPEN

    def close(self) -> None:
        """Close all buses."""
        self.rig.close()
        for bus in self._buses:
            bus.shutdown()


class _Served:
    """Serves the rig on the wall clock while somebody blocks."""

    def __init__(self, bench: Bench):
        self._bench = bench
        self._ended = threading.Event()

    def __enter__(self):
        self._bench._configuring = True
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._ended.set()
        self._thread.join()
        self._bench._configuring = False

    def _serve(self) -> None:
        pause = threading.Event()
        while not self._ended.is_set():
            self._bench.rig.process(time.monotonic_ns())
            pause.wait(2e-4)
